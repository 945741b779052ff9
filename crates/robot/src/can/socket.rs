//! The kernel's CAN interfaces, Linux only.

use std::collections::VecDeque;
use std::io;

use socketcan::{CanSocket, EmbeddedFrame, Frame as _, Socket as _, SocketOptions as _, StandardId};

use super::frame::bring_up;
use super::{CanError, CanFrame, CanTransport};
use crate::stream::is_not_ready;

/// Linux numbers of the errors that an operator can do something about.
const NO_DEVICE: i32 = 19;
const NO_PROTOCOL: i32 = 93;
const NO_FAMILY: i32 = 97;
const NETWORK_DOWN: i32 = 100;
const NO_BUFFERS: i32 = 105;

/// Frames that wait for the interface, whose own queue holds ten by default.
const WAITING: usize = 64;

/// A CAN interface of the kernel.
#[derive(Debug)]
pub struct SocketCanTransport {
    name: String,
    socket: CanSocket,
    waiting: VecDeque<socketcan::CanFrame>,
    /// The controller was in bus-off when it was last looked at.
    off: bool,
}

impl SocketCanTransport {
    /// Opens an interface that is up, such as `can0`.
    ///
    /// # Errors
    /// If the kernel has no CAN, or the interface is absent or down; the message names the command
    /// to type.
    pub fn open(name: &str) -> Result<Self, CanError> {
        let refuse = |message: String| CanError::Open { bus: name.to_owned(), message };
        if name.is_empty()
            || name.len() > 15
            || !name.bytes().all(|b| b.is_ascii_alphanumeric() || b"_-.".contains(&b))
        {
            let message = "no name of an interface: write can0, slcan:/dev/ttyUSB0 or bus:PATH".to_owned();
            return Err(refuse(message));
        }
        // All interfaces at once, only to learn whether this kernel has CAN: names are looked up
        // before that.
        CanSocket::open_iface(0).map_err(|error| refuse(explain(name, &error)))?;
        let socket = CanSocket::open(name).map_err(|error| refuse(explain(name, &error)))?;
        if !is_up(name) {
            return Err(refuse(format!("it is down: type `{}`", bring_up(name))));
        }
        if is_off(name) {
            return Err(CanError::off(name, name));
        }
        let ready = socket.set_nonblocking(true);
        let ready = ready.and_then(|()| socket.set_error_filter(socketcan::errors::CAN_ERR_BUSOFF));
        ready.map_err(|error| refuse(explain(name, &error)))?;
        Ok(Self { name: name.to_owned(), socket, waiting: VecDeque::new(), off: false })
    }

    /// Reports bus-off until it is over. The kernel signals bus-off once, by an error frame, and
    /// then accepts frames without sending them; only the interface shows when it is over. Waiting
    /// frames are dropped: a torque must not come late.
    fn watch(&mut self) -> Result<(), CanError> {
        if !self.off {
            return Ok(());
        }
        self.waiting.clear();
        self.off = is_off(&self.name);
        Err(CanError::off(&self.name, &self.name))
    }

    fn broken(&self, message: String) -> CanError {
        CanError::Broken { bus: self.name.clone(), message }
    }

    fn flush(&mut self) -> Result<(), CanError> {
        while let Some(frame) = self.waiting.front() {
            match self.socket.write_frame(frame) {
                Ok(()) => drop(self.waiting.pop_front()),
                // No room in the queue of the interface is no error.
                Err(error) if is_not_ready(error.kind()) || error.raw_os_error() == Some(NO_BUFFERS) => break,
                Err(error) => return Err(self.broken(explain(&self.name, &error))),
            }
        }
        Ok(())
    }
}

impl CanTransport for SocketCanTransport {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        self.watch()?;
        let id = StandardId::new(frame.id());
        let made = id.and_then(|id| match frame.is_remote() {
            true => socketcan::CanFrame::new_remote(id, 0),
            false => socketcan::CanFrame::new(id, frame.payload()),
        });
        self.waiting.extend(made);
        self.flush()?;
        if self.waiting.len() > WAITING {
            let message = "nothing takes the frames: check the hand's supply, the cable and its terminator";
            return Err(self.broken(message.to_owned()));
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        self.watch()?;
        self.flush()?;
        loop {
            let frame = match self.socket.read_frame() {
                Ok(frame) => frame,
                Err(error) if is_not_ready(error.kind()) => return Ok(None),
                Err(error) => return Err(self.broken(explain(&self.name, &error))),
            };
            if let socketcan::CanFrame::Error(_) = frame {
                // Only bus-off passes the filter.
                self.off = true;
                return self.watch().map(|()| None);
            }
            // Extended identifiers belong to other devices.
            let id = u16::try_from(frame.raw_id()).ok().filter(|_| !frame.is_extended());
            let ours = id.and_then(|id| {
                if frame.is_remote_frame() { CanFrame::remote(id) } else { CanFrame::new(id, frame.data()) }
            });
            if ours.is_some() {
                return Ok(ours);
            }
        }
    }
}

/// Whether the interface has no carrier, which for an interface that is up means bus-off.
fn is_off(name: &str) -> bool {
    let carrier = std::fs::read_to_string(format!("/sys/class/net/{name}/carrier")).unwrap_or_default();
    carrier.trim() == "0"
}

/// Whether the interface is up; if the kernel does not report it, the first frame will show it.
fn is_up(name: &str) -> bool {
    let flags = std::fs::read_to_string(format!("/sys/class/net/{name}/flags")).unwrap_or_default();
    u32::from_str_radix(flags.trim().trim_start_matches("0x"), 16).map_or(true, |flags| flags & 1 != 0)
}

fn explain(name: &str, error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(NO_FAMILY | NO_PROTOCOL) => {
            "this kernel has no CAN: type `modprobe can_raw`; if there is no such module, use a serial \
             adapter (slcan:/dev/ttyUSB0) or bus:PATH"
                .to_owned()
        }
        Some(NO_DEVICE) if name.starts_with("vcan") => {
            format!(
                "there is no such interface: type `ip link add dev {name} type vcan` and `{}`",
                bring_up(name)
            )
        }
        Some(NO_DEVICE) => format!("no such interface: plug the adapter in, then type `{}`", bring_up(name)),
        Some(NETWORK_DOWN) => format!("it is down: type `{}`", bring_up(name)),
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_say_what_to_type() {
        let said = |name: &str, code| explain(name, &io::Error::from_raw_os_error(code));
        assert!(said("can0", NO_DEVICE).contains("`ip link set can0 up type can bitrate 1000000`"));
        assert!(said("can1", NETWORK_DOWN).contains("`ip link set can1 up type can bitrate 1000000`"));
        assert!(said("vcan0", NO_DEVICE).contains("`ip link add dev vcan0 type vcan`"));
        assert!(said("can0", NO_FAMILY).contains("modprobe can_raw"));
        let off = CanError::off("can0", "can0").to_string();
        let typed = "`ip link set can0 down` and `ip link set can0 up type can bitrate 1000000`";
        assert!(off.contains("bus-off") && off.contains(typed), "{off}");
        for name in ["", "../etc", "a very long name of an interface"] {
            assert!(SocketCanTransport::open(name).unwrap_err().to_string().contains("can0"), "{name}");
        }
        // Absent, or no CAN at all: either way there is something to type.
        assert!(SocketCanTransport::open("can77").unwrap_err().to_string().contains("type `"));
    }
}
