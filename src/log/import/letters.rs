//! The bytes of a text file in; its text out.

use std::borrow::Cow;

/// The text, and a note where it is another encoding than UTF-8: UTF-16 with its mark, as spreadsheets
/// write it, or else Latin-1, as programs on Windows write a degree sign.
///
/// # Errors
/// In words: the bytes are no text.
pub fn text(bytes: &[u8]) -> Result<(Cow<'_, str>, Option<String>), String> {
    let not_utf8 = match std::str::from_utf8(bytes) {
        Ok(text) => return Ok((text.into(), None)),
        Err(e) => e.valid_up_to(),
    };
    let wide = |of: fn([u8; 2]) -> u16| {
        let (pairs, odd) = bytes.as_chunks::<2>();
        let letters = pairs.iter().skip(1).map(|pair| of(*pair));
        let text: Result<String, _> = char::decode_utf16(letters).collect();
        text.ok().filter(|_| odd.is_empty())
    };
    let (found, name) = match bytes {
        [0xff, 0xfe, ..] => (wide(u16::from_le_bytes), "UTF-16"),
        [0xfe, 0xff, ..] => (wide(u16::from_be_bytes), "UTF-16"),
        _ => (bytes.iter().map(|b| latin(*b)).collect(), "Latin-1"),
    };
    let text = found.ok_or_else(|| {
        format!("neither text nor a MATLAB 5 MAT file, Parquet or ULog: byte {not_utf8} is no text")
    })?;
    Ok((text.into(), Some(format!("read as {name}: byte {not_utf8} is not UTF-8"))))
}

/// The letter of a byte; none for those that no text has.
fn latin(byte: u8) -> Option<char> {
    let letter = char::from(byte);
    (!letter.is_control() || matches!(letter, '\t' | '\n' | '\r')).then_some(letter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_other_encodings_are_read_and_bytes_that_are_none_refused() {
        assert_eq!(text("t,°".as_bytes()), Ok(("t,°".into(), None)));
        let (latin, note) = text(b"alpha [\xb0]\r\n1\n").unwrap();
        assert_eq!(latin, "alpha [°]\r\n1\n");
        assert!(note.unwrap().contains("Latin-1: byte 7"));
        let wide = |swap: bool| -> Vec<u8> {
            let letters = "\u{feff}t;µ\n".encode_utf16();
            letters.flat_map(|l| if swap { l.to_be_bytes() } else { l.to_le_bytes() }).collect()
        };
        for swap in [false, true] {
            let bytes = wide(swap);
            let (text, note) = text(&bytes).unwrap();
            assert_eq!(text, "t;µ\n");
            assert!(note.unwrap().contains("UTF-16"));
        }
        assert!(text(&wide(false)[..5]).is_err());
        assert!(text(b"\xff\x01\x02").unwrap_err().contains("byte 0 is no text"));
    }
}
