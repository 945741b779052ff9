//! An emulated serial CAN adapter: the protocol of [`etude_robot::can::encode_frame`] from the adapter's side.

use etude_robot::can::{CanFrame, SlcanLines, SlcanReply, encode_frame, parse_frame};

/// The adapter's end of the protocol: what a serial adapter on a bus of 1 Mbit/s does with the bytes of its
/// host.
#[derive(Clone, Debug, Default)]
pub(crate) struct SlcanAdapter {
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
    /// Takes bytes of the host; appends the frames that go to the bus, and the answers to the host.
    pub fn take_bytes(&mut self, bytes: &[u8], frames: &mut Vec<CanFrame>, answers: &mut Vec<u8>) {
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
    pub fn send_frame(&self, frame: &CanFrame, bytes: &mut Vec<u8>) {
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

    fn ask(adapter: &mut SlcanAdapter, text: &[u8]) -> (Vec<CanFrame>, String) {
        let (mut frames, mut answers) = (vec![], vec![]);
        adapter.take_bytes(text, &mut frames, &mut answers);
        (frames, String::from_utf8(answers).unwrap())
    }

    #[test]
    fn the_adapter_obeys_in_order() {
        let mut adapter = SlcanAdapter::default();
        let silent = |adapter: &SlcanAdapter| {
            let mut bytes = vec![];
            adapter.send_frame(&CanFrame::remote(1).unwrap(), &mut bytes);
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
        fn any_bytes_are_survived(
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'\r'), Just(b't')], 0..500),
        ) {
            let mut adapter = SlcanAdapter::default();
            let _ = ask(&mut adapter, b"S8\rO\r");
            let (mut frames, mut answers) = (vec![], vec![]);
            adapter.take_bytes(&bytes, &mut frames, &mut answers);
            for end in 0..bytes.len() {
                let _ = parse_frame(&bytes[..end]);
            }
        }
    }
}
