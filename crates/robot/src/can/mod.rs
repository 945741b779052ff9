//! CAN frames, and the transports that carry them.
//!
//! | carrier | for |
//! |---|---|
//! | [`SocketCanTransport`] | the kernel's CAN (`can0`), Linux only |
//! | [`SlcanTransport`] | a serial adapter (`slcan:/dev/ttyUSB0`), any Unix; or a virtual bus between processes without any hardware (`bus:/path`), served by `etude-emulators` |

mod frame;
mod slcan;
mod slcan_stream;
#[cfg(target_os = "linux")]
mod socket;

pub use frame::{CanError, CanFrame, CanTransport};
pub use slcan::{BUS_OFF, BUS_ON, SlcanError, SlcanLines, SlcanReply, encode_frame, parse_frame};
pub use slcan_stream::{SlcanPort, SlcanTransport};
#[cfg(target_os = "linux")]
pub use socket::SocketCanTransport;

/// What a serial adapter's spec begins with.
const SERIAL: &str = "slcan:";
/// What the spec of a virtual bus begins with.
const HUB: &str = "bus:";

/// Opens the bus that `spec` names: `can0` or `vcan0` (the kernel's), `slcan:/dev/ttyUSB0` (a
/// serial adapter; the serial speed may follow as `@115200`), or `bus:/path/to/socket` (a virtual
/// bus).
///
/// # Errors
/// If there is no such bus; the message names the command to type.
pub fn open(spec: &str) -> Result<Box<dyn CanTransport>, CanError> {
    if let Some(port) = spec.strip_prefix(SERIAL) {
        return Ok(Box::new(SlcanTransport::open(port)?));
    }
    if let Some(path) = spec.strip_prefix(HUB) {
        return Ok(Box::new(SlcanTransport::connect(path)?));
    }
    open_interface(spec)
}

/// The bus that `spec` names, the same for every spelling of it.
pub fn device(spec: &str) -> String {
    let (kind, path) = match (spec.strip_prefix(SERIAL), spec.strip_prefix(HUB)) {
        (Some(port), _) => (SERIAL, port.rsplit_once('@').map_or(port, |(path, _)| path)),
        (_, Some(path)) => (HUB, path),
        _ => return spec.to_string(),
    };
    // A link such as /dev/serial/by-id/… is the same device.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    format!("{kind}{}", path.display())
}

/// Whether `spec` names a serial adapter, whose channel has to be opened and is one program's.
pub(crate) fn is_serial(spec: &str) -> bool {
    spec.starts_with(SERIAL)
}

/// Joins the bus that `spec` names while another program may be using it: a serial adapter's
/// channel is neither set up, opened nor closed. Everything else is as in [`open`].
///
/// # Errors
/// If there is no such bus; the message names the command to type.
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

#[cfg(test)]
mod tests {
    use super::device;

    #[test]
    fn a_device_has_one_name() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let [tty, link] = ["tty", "link"].map(|name| folder.join(name));
        std::fs::write(&tty, "").unwrap();
        std::os::unix::fs::symlink(&tty, &link).unwrap();
        let [tty, link] = [tty, link].map(|path| path.display().to_string());
        assert_eq!(device(&format!("slcan:{link}@115200")), format!("slcan:{tty}"));
        assert_eq!(device(&format!("bus:{link}")), format!("bus:{tty}"));
        assert_eq!((device("can0"), device("bus:/none/x")), ("can0".to_string(), "bus:/none/x".to_string()));
    }
}
