//! Records in; the same records, with samples in a file of this process where they would take more memory
//! than they may, out.
//!
//! An estimate over all maneuvers of a campaign holds the samples of all of them and reads them once in
//! each iteration. In a file they cost no memory that the system could not use otherwise: it keeps what
//! is read often, and drops what it needs the room for. The file has no name, so nobody else can change it
//! and nothing is left of it however the process ends.

use super::Record;
use super::filed::{EACH, Filed};
use super::numbers::Numbers;
use memmap2::MmapOptions;
use std::fs::File;
use std::io::{self, Write};
use std::sync::Arc;

/// What samples may take in memory, and the file for all others.
#[derive(Debug)]
pub struct Scratch {
    /// Bytes that are left.
    left: usize,
    file: Option<File>,
    /// Bytes in the file.
    written: u64,
}

impl Scratch {
    /// Samples of at most so many bytes stay in memory.
    pub fn beyond(bytes: usize) -> Scratch {
        Scratch { left: bytes, file: None, written: 0 }
    }

    /// Bytes in the file.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Counts a record's samples, or puts them into the file where there is no more room for them.
    /// Channels that share their times go on sharing them.
    ///
    /// # Errors
    /// The file cannot be made, or there is no room for it.
    pub fn take(&mut self, record: &mut Record) -> io::Result<()> {
        let mut all: Vec<&mut Numbers> = vec![&mut record.inputs];
        for channel in &mut record.channels {
            all.extend([&mut channel.t, &mut channel.z]);
        }
        all.retain(|numbers| numbers.is_here() && !numbers.is_empty());
        let mut distinct: Vec<(*const f64, Numbers)> = Vec::new();
        for numbers in &all {
            if distinct.iter().all(|(known, _)| *known != numbers.as_ptr()) {
                distinct.push((numbers.as_ptr(), (*numbers).clone()));
            }
        }
        let bytes: usize = distinct.iter().map(|(_, numbers)| numbers.len() * EACH).sum();
        if bytes <= self.left {
            self.left -= bytes;
            return Ok(());
        }
        let filed = self.file(distinct.iter().map(|(_, numbers)| numbers))?;
        for numbers in all {
            if let Some(at) = distinct.iter().position(|(known, _)| *known == numbers.as_ptr()) {
                *numbers = Numbers::filed(filed[at].clone());
            }
        }
        Ok(())
    }

    /// Writes samples behind those in the file.
    fn file<'a>(&mut self, all: impl Iterator<Item = &'a Numbers>) -> io::Result<Vec<Filed>> {
        let mut file = match self.file.take() {
            Some(file) => file,
            None => tempfile::tempfile()?,
        };
        let (mut bytes, mut places) = (Vec::new(), Vec::new());
        for numbers in all {
            places.push((bytes.len() / EACH, numbers.len()));
            numbers.iter().for_each(|number| bytes.extend(number.to_ne_bytes()));
        }
        file.write_all(&bytes)?;
        // SAFETY: the file has no name, and what was written is not written again.
        let map = unsafe { MmapOptions::new().offset(self.written).len(bytes.len()).map(&file)? };
        let map = Arc::new(map);
        self.written += bytes.len() as u64;
        self.file = Some(file);
        let filed = |(from, count)| Filed::of(map.clone(), from, count);
        Ok(places.into_iter().map(filed).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Channel;

    fn record(k: usize) -> Record {
        let t: Numbers = (0..50).map(|i| f64::from(i) * 0.1).collect();
        let channel = |output: usize| Channel {
            output,
            t: t.clone(),
            z: (0..50).map(|i| (k * 1000 + output * 100 + i) as f64).collect(),
        };
        Record {
            n: 50,
            inputs: vec![0.5; 50].into(),
            channels: vec![channel(0), channel(1)],
            ..Record::default()
        }
    }

    #[test]
    fn samples_beyond_the_limit_stand_in_a_file_and_are_the_same() {
        // times are counted once: inputs, times and two columns are 1600 bytes
        let mut scratch = Scratch::beyond(3300);
        let mut records: Vec<Record> = (0..5).map(record).collect();
        records.iter_mut().for_each(|r| scratch.take(r).expect("a file"));
        assert_eq!(scratch.written(), 3 * 1600);
        for (k, found) in records.iter().enumerate() {
            assert_eq!(*found, record(k));
            assert_eq!(found.channels[1].z.is_here(), k < 2);
            let [a, b] = [&found.channels[0].t, &found.channels[1].t];
            assert!(std::ptr::eq(a.as_ptr(), b.as_ptr()));
        }
        // One that is changed is in memory again, the others are as they were.
        let (mut changed, kept) = (records[4].clone(), records[4].clone());
        changed.channels[0].z[3] = -1.0;
        changed.channels[1].z.append(&[7.0]);
        assert_eq!((changed.channels[0].z[3], changed.channels[1].z.len()), (-1.0, 51));
        assert_eq!(kept, record(4));
        // Taken again it is counted as nothing.
        scratch.take(&mut records[4]).expect("a file");
        assert_eq!(scratch.written(), 3 * 1600);
    }
}
