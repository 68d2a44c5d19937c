//! The path of a log in; stretches of its bytes, read when they are asked for, out.
//!
//! A log is never mapped: another program that cuts a mapped file short stops this one, where a
//! read can say what is no longer there.

use crate::error::{Error, Result};
use std::fs::File;
use std::path::{Path, PathBuf};

/// What is read at a time where nothing larger is asked for.
pub(super) const STRETCH: usize = 64 << 10;

/// A log that is open, and how long it was then.
pub(super) struct Source {
    file: File,
    path: PathBuf,
    size: usize,
}

impl Source {
    /// Opens a file that is not empty.
    ///
    /// # Errors
    /// It is not there, cannot be read, is no file, or is empty.
    pub fn open(path: &Path) -> Result<Source> {
        let failed =
            |e: std::io::Error| Error::new(format!("cannot read the log {}: {e}", path.display()));
        // A pipe would be waited for: what a path leads to is asked before it is opened.
        let about = std::fs::metadata(path).map_err(failed)?;
        if !about.is_file() {
            let what = if about.is_dir() { "a folder" } else { "a pipe or a device, no file" };
            return Err(Error::new(format!("the log {} is {what}", path.display()))
                .help("take it out of the campaign, or name a file"));
        }
        let file = File::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        if size == 0 {
            return Err(Error::new(format!("the log {} is empty (0 bytes)", path.display()))
                .help("the recorder did not write anything: copy the file again, or take it out of the campaign"));
        }
        let size = usize::try_from(size).map_err(|e| failed(std::io::Error::other(e)))?;
        Ok(Source { file, path: path.to_path_buf(), size })
    }

    /// How many bytes it had when it was opened.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Fills the buffer with what stands from byte `at` on.
    ///
    /// # Errors
    /// The file does not have so many bytes, or cannot be read.
    pub fn read(&self, at: usize, buffer: &mut [u8]) -> Result<()> {
        let mut read = 0;
        while let Some(rest) = buffer.get_mut(read..).filter(|rest| !rest.is_empty()) {
            match self.read_some(at + read, rest) {
                Ok(0) => return Err(self.shorter(at, buffer.len(), at + read)),
                Ok(n) => read += n,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => {
                    let path = self.path.display();
                    let what = format!("cannot read the log {path} from byte {}: {e}", at + read);
                    return Err(Error::new(what));
                }
            }
        }
        Ok(())
    }

    #[cfg(unix)]
    fn read_some(&self, at: usize, buffer: &mut [u8]) -> std::io::Result<usize> {
        std::os::unix::fs::FileExt::read_at(&self.file, buffer, at as u64)
    }

    /// Threads share the file and its one place: each read opens it for itself.
    #[cfg(not(unix))]
    fn read_some(&self, at: usize, buffer: &mut [u8]) -> std::io::Result<usize> {
        use std::io::{Read, Seek, SeekFrom};
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(at as u64))?;
        file.read(buffer)
    }

    fn shorter(&self, at: usize, wanted: usize, end: usize) -> Error {
        Error::new(format!(
            "the log {} was cut short while it was read: {wanted} bytes are wanted from byte {at}, and it ends by byte {end}; it had {} bytes",
            self.path.display(),
            self.size
        ))
        .help("let the program that writes it finish, and run again")
    }

    /// The checksum (CRC-32) of the bytes from `from` to `to`, which are there.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn checksum(&self, from: usize, to: usize) -> Result<u32> {
        let mut hasher = crc32fast::Hasher::new();
        let mut buffer = vec![0; STRETCH];
        for at in (from..to).step_by(STRETCH) {
            let stretch = &mut buffer[..STRETCH.min(to - at)];
            self.read(at, stretch)?;
            hasher.update(stretch);
        }
        Ok(hasher.finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{START, one_signal, raw, read, regular};
    use super::super::window::Window;
    use super::super::{Buffer, LogFile};
    use super::*;

    #[test]
    fn fault_a_log_that_is_cut_short_while_it_is_open_is_an_error_with_file_and_byte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        raw(&path, "json", &regular(5000), 4000);
        let log = LogFile::open(&path).unwrap();
        let last = log.parts() - 1;
        let file = File::options().write(true).open(&path).unwrap();
        file.set_len(log.offset(last) as u64 + 10).unwrap();
        let mut buffer = Buffer::default();
        let mut count = 0;
        for part in 0..last {
            assert_eq!(log.messages(part, &mut buffer, |_| count += 1).unwrap(), None);
        }
        assert!(count > 4500);
        let e = log.messages(last, &mut buffer, |_| ()).unwrap_err().to_string();
        let from = format!("wanted from byte {}", log.offset(last));
        let by = format!("ends by byte {}", log.offset(last) + 10);
        for wanted in [path.display().to_string(), from, by] {
            assert!(e.contains(&wanted), "{e}");
        }
        // A walk that meets the new end says the same.
        let source = Source::open(&path).unwrap();
        file.set_len(100).unwrap();
        let e = Window::of(&source).bytes(90, 20).unwrap_err().to_string();
        assert!(e.contains("was cut short while it was read"), "{e}");
        file.set_len(0).unwrap();
        assert!(log.messages(0, &mut buffer, |_| ()).is_err());
    }

    #[test]
    fn a_window_sees_the_bytes_of_the_file_wherever_it_stands() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bytes");
        let bytes: Vec<u8> = (0..3 * STRETCH + 17).map(|i| (i * i / 251 % 251) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let source = Source::open(&path).unwrap();
        let mut window = Window::of(&source);
        for (at, n) in [
            (0, 9),
            (STRETCH - 3, 9),
            (5, 2 * STRETCH),
            (STRETCH, 1),
            (bytes.len() - 4, 9),
            (bytes.len(), 9),
            (bytes.len() + 9, 9),
            (3, 0),
        ] {
            let wanted = bytes.get(at..(at + n).min(bytes.len())).unwrap_or(&[]);
            assert_eq!(window.bytes(at, n).unwrap(), wanted, "{n} from {at}");
        }
        for from in [0, 1000, STRETCH - 1, 3 * STRETCH] {
            let to = bytes.len() - 3;
            let wanted = bytes[from..to].iter().position(|b| *b == 77).map(|i| from + i);
            assert_eq!(window.find(77, from, to).unwrap(), wanted, "from {from}");
        }
        assert_eq!(window.find(255, 0, bytes.len()).unwrap(), None);
        let (from, to) = (100, 2 * STRETCH + 5);
        assert_eq!(source.checksum(from, to).unwrap(), crc32fast::hash(&bytes[from..to]));
    }

    #[test]
    fn messages_outside_chunks_are_read_across_the_stretches_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let options = mcap::WriteOptions::new().use_chunks(false);
        let file = std::io::BufWriter::new(File::create(&path).unwrap());
        let mut log = options.create(file).unwrap();
        let channel_id = log.add_channel(0, "/t", "json", &Default::default()).unwrap();
        let wide = |i: usize| if i % 100 == 50 { 2 * STRETCH } else { i % 700 };
        for i in 0..2000 {
            let time = START + i as u64 * 10_000_000;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: time,
                publish_time: time,
            };
            let text = format!("{{\"x\":{i},\"y\":\"{}\"}}", "y".repeat(wide(i)));
            log.write_to_known_channel(&header, text.as_bytes()).unwrap();
        }
        log.finish().unwrap();
        drop(log);
        let flight = read(&path, &one_signal("log")).unwrap();
        assert!(flight.notes.is_empty(), "{:?}", flight.notes);
        let values = &flight.signals["x"].series.value;
        assert!(values.len() == 2000 && values.iter().enumerate().all(|(i, x)| *x == i as f64));
    }
}
