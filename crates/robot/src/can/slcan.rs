//! The ASCII protocol of serial CAN adapters ("slcan", after the LAWICEL adapters), both ends.
//!
//! A command is a line that ends with a carriage return. `t18027701` is a data frame: identifier (3 hex
//! digits), length (1), bytes; `r2000` a remote request; `T` and `R` the same with 8 digits of identifier.
//! The adapter answers a carriage return, a `z` or `Z` before it for frames, or a bell if it refuses; frames
//! from the bus come in between, with four more digits when time stamps are on.

use super::CanFrame;

/// The longest line there is: an extended frame with eight bytes and a time stamp.
const LONGEST: usize = 1 + 8 + 1 + 16 + 4;

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
    line: [u8; LONGEST],
    len: usize,
    over: bool,
}

impl SlcanLines {
    /// Takes one byte.
    pub fn push(&mut self, byte: u8) -> Option<SlcanReply<'_>> {
        match byte {
            b'\r' | 0x07 => {
                let (len, over) = (self.len.min(LONGEST), self.over);
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
                self.len = (self.len + 1).min(LONGEST);
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

/// The frame of a line without its carriage return; `None` for an extended one, which no device here uses.
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

/// The adapter's end of the protocol: what a serial adapter on a bus of 1 Mbit/s does with the bytes of its
/// host.
#[derive(Clone, Debug, Default)]
pub struct SlcanAdapter {
    lines: SlcanLines,
    channel: Channel,
    /// `S8`, 1 Mbit/s, is the speed of the bus; at any other nothing is heard and nothing acknowledged.
    right_speed: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Channel {
    #[default]
    Closed,
    Open,
    ListenOnly,
}

impl SlcanAdapter {
    /// An adapter just plugged in: channel closed, no speed set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes of the host; appends the frames that go to the bus, and the answers to the host.
    pub fn from_host(&mut self, bytes: &[u8], frames: &mut Vec<CanFrame>, answers: &mut Vec<u8>) {
        for &byte in bytes {
            let mut lines = std::mem::take(&mut self.lines);
            match lines.push(byte) {
                None | Some(SlcanReply::Bell) => {}
                Some(SlcanReply::Damaged) => answers.push(0x07),
                Some(SlcanReply::Line(line)) => match self.obey(line, frames) {
                    Some(answer) => answers.extend(answer.iter().chain(b"\r")),
                    None => answers.push(0x07),
                },
            }
            self.lines = lines;
        }
    }

    /// Appends a frame of the bus as the host gets it: not at all while the channel is closed.
    pub fn to_host(&self, frame: &CanFrame, bytes: &mut Vec<u8>) {
        if self.channel != Channel::Closed && self.right_speed {
            encode_frame(frame, bytes);
        }
    }

    /// Obeys a command and gives the answer, or refuses.
    fn obey(&mut self, line: &[u8], frames: &mut Vec<CanFrame>) -> Option<&'static [u8]> {
        let closed = self.channel == Channel::Closed;
        match line {
            [] => Some(b""),
            [b'S', speed @ b'0'..=b'8'] if closed => {
                self.right_speed = *speed == b'8';
                Some(b"")
            }
            b"O" if closed => {
                self.channel = Channel::Open;
                Some(b"")
            }
            b"L" if closed => {
                self.channel = Channel::ListenOnly;
                Some(b"")
            }
            b"C" if !closed => {
                self.channel = Channel::Closed;
                Some(b"")
            }
            b"V" => Some(b"V1013"),
            b"N" => Some(b"NETUD"),
            b"F" if !closed => Some(b"F00"),
            // Time stamps can be switched off, where they are.
            b"Z0" if closed => Some(b""),
            [kind @ (b't' | b'r' | b'T' | b'R'), ..] if self.channel == Channel::Open && self.right_speed => {
                frames.extend(parse_frame(line).ok()?);
                Some(if kind.is_ascii_lowercase() { b"z" } else { b"Z" })
            }
            _ => None,
        }
    }
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

    fn ask(adapter: &mut SlcanAdapter, text: &[u8]) -> (Vec<CanFrame>, String) {
        let (mut frames, mut answers) = (vec![], vec![]);
        adapter.from_host(text, &mut frames, &mut answers);
        (frames, String::from_utf8(answers).unwrap())
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

    #[test]
    fn the_adapter_obeys_in_order() {
        let mut adapter = SlcanAdapter::new();
        let silent = |adapter: &SlcanAdapter| {
            let mut bytes = vec![];
            adapter.to_host(&CanFrame::remote(1).unwrap(), &mut bytes);
            bytes.is_empty()
        };
        assert_eq!(
            ask(&mut adapter, b"t1801AA\rC\rV\rN\rF\r"),
            (vec![], "\x07\x07V1013\rNETUD\r\x07".into())
        );
        // As python-can opens: close, speed, an empty data speed, open, and open again.
        assert_eq!(ask(&mut adapter, b"C\rS6\r\rO\rO\r"), (vec![], "\x07\r\r\r\x07".into()));
        assert_eq!(ask(&mut adapter, b"t1801AA\r"), (vec![], "\x07".into()));
        assert!(silent(&adapter), "500 kbit/s");
        assert_eq!(ask(&mut adapter, b"S8\rC\rS8\rZ0\rZ1\rO\rF\r").1, "\x07\r\r\r\x07\rF00\r");
        assert!(!silent(&adapter));
        // In pieces, byte by byte.
        let mut all = (vec![], String::new());
        for byte in b"t1801AA\rr2000\rT000001801AA\rt18X\r" {
            let (frames, answers) = ask(&mut adapter, &[*byte]);
            all.0.extend(frames);
            all.1 += &answers;
        }
        let frames = vec![CanFrame::new(0x180, &[0xAA]).unwrap(), CanFrame::remote(0x200).unwrap()];
        assert_eq!(all, (frames, "z\rz\rZ\r\x07".into()));
        assert_eq!(ask(&mut adapter, &[b'A'; 100]), (vec![], String::new()));
        assert_eq!(ask(&mut adapter, b"\rr2000\r").1, "\x07z\r");
        assert_eq!(ask(&mut adapter, b"C\rL\rr2000\r"), (vec![], "\r\r\x07".into()));
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

        #[test]
        fn any_bytes_are_survived(
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'\r'), Just(b't')], 0..500),
        ) {
            let mut adapter = SlcanAdapter::new();
            let _ = ask(&mut adapter, b"S8\rO\r");
            let (mut frames, mut answers) = (vec![], vec![]);
            adapter.from_host(&bytes, &mut frames, &mut answers);
            for end in 0..bytes.len() {
                let _ = parse_frame(&bytes[..end]);
            }
        }
    }
}
