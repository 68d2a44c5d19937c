//! A byte slice in, little-endian numbers and MCAP records out, never reading past its end.

/// The bytes not read yet.
pub(super) struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    #[inline]
    pub fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(n)?;
        self.0 = tail;
        Some(head)
    }

    #[inline]
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk::<N>()?;
        self.0 = tail;
        Some(*head)
    }

    #[inline]
    pub fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    #[inline]
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    #[inline]
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    #[inline]
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// The next record (operation code and body); on `None` nothing is consumed.
    #[inline]
    pub fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let mut ahead = Bytes(self.0);
        let code = ahead.u8()?;
        let length = usize::try_from(ahead.u64()?).ok()?;
        let body = ahead.take(length)?;
        self.0 = ahead.0;
        Some((code, body))
    }
}

/// A string with its length in front.
pub(super) fn parse_string<'a>(b: &mut Bytes<'a>) -> Option<&'a str> {
    let n = b.u32()? as usize;
    std::str::from_utf8(b.take(n)?).ok()
}
