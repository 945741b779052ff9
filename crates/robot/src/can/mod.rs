//! CAN frames, and what carries them.
//!
//! | carrier | for |
//! |---|---|
//! | [`SocketCanTransport`] | the kernel's CAN (`can0`), Linux only |
//! | [`SlcanTransport`] | a serial adapter (`slcan:/dev/ttyUSB0`), any Unix |
//! | [`HubTransport`] | a bus between processes without any hardware (`bus:/path`), served by the hub in `etude-emulators` |

mod frame;
mod hub;
mod slcan;
mod slcan_stream;
#[cfg(target_os = "linux")]
mod socket;

pub use frame::{CanError, CanFrame, CanTransport};
pub use hub::{HubLink, HubRecord, HubTransport};
pub use slcan::{SlcanError, SlcanLines, SlcanReply, encode_frame, parse_frame};
pub use slcan_stream::{SlcanPort, SlcanTransport};
#[cfg(target_os = "linux")]
pub use socket::SocketCanTransport;

/// What a serial adapter's spec begins with.
const SERIAL: &str = "slcan:";

/// Opens the bus that `spec` names: `can0` or `vcan0` (the kernel's), `slcan:/dev/ttyUSB0` (a serial adapter;
/// the serial speed may follow as `@115200`), or `bus:/path/to/socket` (a hub).
///
/// # Errors
/// If there is no such bus; the message says what to type.
pub fn open(spec: &str) -> Result<Box<dyn CanTransport>, CanError> {
    if let Some(port) = spec.strip_prefix(SERIAL) {
        return Ok(Box::new(SlcanTransport::open(port)?));
    }
    if let Some(path) = spec.strip_prefix("bus:") {
        return Ok(Box::new(HubTransport::connect(path)?));
    }
    open_interface(spec)
}

/// Whether `spec` names a serial adapter, whose channel has to be opened and is one program's.
pub(crate) fn is_serial(spec: &str) -> bool {
    spec.starts_with(SERIAL)
}

/// Joins the bus that `spec` names, for one who comes in beside a program that may be using it: a serial adapter's
/// channel is neither closed, set up nor opened, now or in the end. Everything else is as in [`open`].
///
/// # Errors
/// If there is no such bus; the message says what to type.
pub fn join(spec: &str) -> Result<Box<dyn CanTransport>, CanError> {
    match spec.strip_prefix(SERIAL) {
        Some(port) => Ok(Box::new(SlcanTransport::join(port)?)),
        None => open(spec),
    }
}

#[cfg(target_os = "linux")]
fn open_interface(name: &str) -> Result<Box<dyn CanTransport>, CanError> {
    Ok(Box::new(SocketCanTransport::open(name)?))
}

#[cfg(not(target_os = "linux"))]
fn open_interface(name: &str) -> Result<Box<dyn CanTransport>, CanError> {
    let message =
        "only Linux has CAN interfaces: use a serial adapter (slcan:/dev/tty...) or bus:PATH".to_owned();
    Err(CanError::Open { bus: name.to_owned(), message })
}
