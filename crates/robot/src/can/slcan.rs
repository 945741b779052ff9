//! The ASCII protocol of serial CAN adapters ("slcan", after the LAWICEL adapters).
//!
//! A command is a line that ends with a carriage return. `t18027701` is a data frame: identifier (3
//! hex digits), length (1), bytes; `r2000` a remote request; `T` and `R` the same with 8 digits of
//! identifier. The adapter answers a carriage return, a `z` or `Z` before it for frames, or a bell
//! if it refuses; frames from the bus come in between, with four more digits when time stamps are
//! on.

use super::CanFrame;

/// What a virtual bus says when it goes into bus-off, and when it comes out of it: the adapters'
/// status flags, of which bit 7 is an error of the bus.
pub const BUS_OFF: &[u8] = b"F80";
/// The other one.
pub const BUS_ON: &[u8] = b"F00";
/// The longest line there is: an extended frame with eight bytes and a time stamp.
const MAX_LINE: usize = 1 + 8 + 1 + 16 + 4;

/// A line that is no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a frame: the serial line is damaged; check its cable and its speed")]
pub struct SlcanError;

/// Something complete that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlcanReply<'a> {
    /// A line, without its carriage return.
    Line(&'a [u8]),
    /// A bell: refused.
    Bell,
    /// A line that was too long, thrown away.
    Damaged,
}

/// Puts bytes together to lines.
#[derive(Clone, Debug, Default)]
pub struct SlcanLines {
    line: [u8; MAX_LINE],
    len: usize,
    over: bool,
}

impl SlcanLines {
    /// Takes one byte.
    pub fn push(&mut self, byte: u8) -> Option<SlcanReply<'_>> {
        match byte {
            b'\r' | 0x07 => {
                let (len, over) = (self.len.min(MAX_LINE), self.over);
                (self.len, self.over) = (0, false);
                if byte == 0x07 {
                    Some(SlcanReply::Bell)
                } else if over {
                    Some(SlcanReply::Damaged)
                } else {
                    self.line.get(..len).map(SlcanReply::Line)
                }
            }
            b'\n' => None,
            _ => {
                match self.line.get_mut(self.len) {
                    Some(place) => *place = byte,
                    None => self.over = true,
                }
                self.len = (self.len + 1).min(MAX_LINE);
                None
            }
        }
    }
}

/// Appends the line of a frame, with its carriage return.
pub fn encode_frame(frame: &CanFrame, line: &mut Vec<u8>) {
    let digit = |nibble: u16| {
        char::from_digit(u32::from(nibble & 15), 16).map_or(b'0', |c| c.to_ascii_uppercase() as u8)
    };
    let id = frame.id();
    line.push(if frame.is_remote() { b'r' } else { b't' });
    line.extend([digit(id >> 8), digit(id >> 4), digit(id), digit(frame.payload().len() as u16)]);
    line.extend(
        frame.payload().iter().flat_map(|&byte| [digit(u16::from(byte) >> 4), digit(u16::from(byte))]),
    );
    line.push(b'\r');
}

/// The frame of a line without its carriage return; `None` for an extended one, which no device
/// here uses.
///
/// # Errors
/// If it is no frame.
pub fn parse_frame(line: &[u8]) -> Result<Option<CanFrame>, SlcanError> {
    let (&kind, rest) = line.split_first().ok_or(SlcanError)?;
    let (id_digits, remote) = match kind {
        b't' => (3, false),
        b'r' => (3, true),
        b'T' => (8, false),
        b'R' => (8, true),
        _ => return Err(SlcanError),
    };
    let (id, rest) = rest.split_at_checked(id_digits).ok_or(SlcanError)?;
    let id = id.iter().try_fold(0u32, |id, &digit| Some(id << 4 | nibble(digit)?)).ok_or(SlcanError)?;
    let (&len, rest) = rest.split_first().ok_or(SlcanError)?;
    let len = usize::from(len.checked_sub(b'0').filter(|&len| len <= 8).ok_or(SlcanError)?);
    let (digits, stamp) = rest.split_at_checked(if remote { 0 } else { 2 * len }).ok_or(SlcanError)?;
    if !matches!(stamp.len(), 0 | 4) || stamp.iter().any(|&digit| nibble(digit).is_none()) {
        return Err(SlcanError);
    }
    let mut data = [0; 8];
    let (pairs, _) = digits.as_chunks::<2>();
    for (byte, &[high, low]) in data.iter_mut().zip(pairs) {
        let (high, low) = nibble(high).zip(nibble(low)).ok_or(SlcanError)?;
        *byte = (high << 4 | low) as u8;
    }
    if id_digits == 8 {
        return if id < 1 << 29 { Ok(None) } else { Err(SlcanError) };
    }
    let id = u16::try_from(id).map_err(|_| SlcanError)?;
    let frame =
        if remote { CanFrame::remote(id) } else { CanFrame::new(id, data.get(..len).unwrap_or(&data)) };
    frame.map(Some).ok_or(SlcanError)
}

fn nibble(digit: u8) -> Option<u32> {
    char::from(digit).to_digit(16)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn line(frame: &CanFrame) -> String {
        let mut bytes = vec![];
        encode_frame(frame, &mut bytes);
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn lines_by_hand() {
        let torque = CanFrame::new(0x180, &[0x77, 0x01, 0xA3, 0x02, 0x3E, 0xFE, 0xE3, 0xFE]).unwrap();
        assert_eq!(line(&torque), "t18087701A3023EFEE3FE\r");
        assert_eq!(line(&CanFrame::remote(0x200).unwrap()), "r2000\r");
        assert_eq!(line(&CanFrame::new(0x7FF, &[]).unwrap()), "t7FF0\r");
        for text in ["t18087701A3023EFEE3FE", "t18087701a3023efee3fe", "t18087701A3023EFEE3FE1234"] {
            assert_eq!(parse_frame(text.as_bytes()), Ok(Some(torque)), "{text}");
        }
        assert_eq!((parse_frame(b"T1234567F155"), parse_frame(b"R000002000")), (Ok(None), Ok(None)));
        for text in [
            "",
            "t",
            "t18",
            "t1809",
            "t800112",
            "t1801",
            "t18021",
            "t1801XX",
            "r20001",
            "x",
            "t18015512",
            "T200000001AA",
        ] {
            assert_eq!(parse_frame(text.as_bytes()), Err(SlcanError), "{text}");
        }
    }

    proptest! {
        #[test]
        fn frames_come_back(
            id in 0u16..=CanFrame::MAX_ID, data in prop::collection::vec(any::<u8>(), 0..=8), remote: bool,
        ) {
            let frame = if remote { CanFrame::remote(id) } else { CanFrame::new(id, &data) }.unwrap();
            let text = line(&frame);
            prop_assert_eq!(parse_frame(text.trim_end().as_bytes()), Ok(Some(frame)));
            let mut lines = SlcanLines::default();
            let read: Vec<_> = text.bytes().filter_map(|byte| match lines.push(byte)? {
                SlcanReply::Line(line) => Some(line.to_vec()),
                _ => None,
            }).collect();
            prop_assert_eq!(read, [text.trim_end().as_bytes()]);
        }
    }
}
