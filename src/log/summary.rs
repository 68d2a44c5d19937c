//! A log in; the summary section at its end, with what it is worth, out.

use super::bytes::Bytes;
use super::records::op;
use super::search::begins;
use super::walk::Walk;
use super::window::Window;
use crate::error::Result;

/// The summary section, with the footer behind it.
pub(super) struct Summary {
    pub walk: Walk,
    pub start: usize,
    pub checksum: Checksum,
    /// It is not where the footer says.
    pub is_moved: bool,
}

/// Bytes of a footer with the closing magic: operation code, length 20, three numbers; the magic.
pub(super) const FOOTER: usize = 29 + mcap::MAGIC.len();
/// A summary that is not where the footer says is looked for so many bytes in front of it, at so many places.
pub(super) const FARTHEST: usize = 16 << 20;
const MOST_PLACES: usize = 16;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Checksum {
    None,
    Right,
    Wrong,
}

impl Summary {
    /// The summary of a log that ends here. None where it has no footer there, or one that tells of no
    /// summary.
    pub fn ending(log: &mut Window, end: usize) -> Result<Option<Summary>> {
        let Some(at) = end.checked_sub(FOOTER) else { return Ok(None) };
        let Some((start, crc)) = footer(log.bytes(at, FOOTER)?) else { return Ok(None) };
        if start == 0 {
            return Ok(None);
        }
        let told = if start < at { Some(Summary::at(log, start, at, crc)?) } else { None };
        if told.as_ref().is_some_and(Summary::is_sound) {
            return Ok(told);
        }
        Ok(Summary::moved(log, start, at, crc)?.or(told))
    }

    /// The summary before a footer at `at` where it is not where that says, because bytes in front of it were
    /// lost or added: it stands behind the end of the data, and what it says is as it was. Where it is further
    /// on by as much as another log begins behind this one, it is that log's.
    fn moved(log: &mut Window, told: usize, at: usize, crc: u32) -> Result<Option<Summary>> {
        let (mut from, mut places) = (at.saturating_sub(FARTHEST), 0);
        while let Some(here) = log.find(op::DATA_END, from, at)?
            && places < MOST_PLACES
        {
            from = here + 1;
            let Some(end) = log.record(here)?.filter(|r| r.length() == 4) else { continue };
            places += 1;
            let is_of_another = match end.end.checked_sub(told) {
                Some(by) if by > 0 => begins(log, by)?,
                _ => false,
            };
            if end.end >= at || is_of_another {
                continue;
            }
            let mut found = Summary::at(log, end.end, at, crc)?;
            if found.is_trusted() && found.walk.end == at {
                // its places are those of before
                found.walk.indexed.clear();
                return Ok(Some(Summary { is_moved: true, ..found }));
            }
        }
        Ok(None)
    }

    /// The summary from `start` to the footer at `at`.
    fn at(log: &mut Window, start: usize, at: usize, crc: u32) -> Result<Summary> {
        // Covers everything from the start of the summary to the checksum itself; 0: not recorded.
        let checksum = match crc {
            0 => Checksum::None,
            crc if log.source().checksum(start, at + 25)? == crc => Checksum::Right,
            _ => Checksum::Wrong,
        };
        Ok(Summary { walk: Walk::summary(log, start)?, start, checksum, is_moved: false })
    }

    /// Whether it is as it was written, as far as can be seen, and names channels.
    pub fn is_trusted(&self) -> bool {
        self.is_sound() && !self.walk.data.is_empty()
    }

    pub fn is_sound(&self) -> bool {
        let intact = self.walk.whole && self.walk.damage.is_empty();
        intact && self.checksum != Checksum::Wrong
    }
}

/// Where the summary starts and its checksum, from a footer with the closing magic.
fn footer(bytes: &[u8]) -> Option<(usize, u32)> {
    let mut b = Bytes(bytes.strip_suffix(mcap::MAGIC)?);
    let (code, length) = (b.u8()?, b.u64()?);
    let (start, _) = (usize::try_from(b.u64()?).ok()?, b.u64()?);
    let crc = b.u32()?;
    (code == op::FOOTER && length == 20).then_some((start, crc))
}
