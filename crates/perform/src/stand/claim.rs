//! The claim on a robot: only one process moves it, and any other can request it to stop.
//!
//! Claims and requests belong to the devices that move, not to the rig's file: a copy of the file names the same robot. They are files
//! in `/tmp/etude`, one for each device, which every user of this machine may write. A program claims the robot before it does anything
//! else and keeps it until it ends, so that no request made meanwhile is lost.

use std::fs::{File, OpenOptions, Permissions};
use std::io::{Error, ErrorKind, Result};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use etude_robot::rig::WiresConfig;
use etude_robot::{can, xarm};

/// A robot that this process alone may move.
#[derive(Debug)]
pub struct Claim {
    devices: Vec<ClaimedDevice>,
}

#[derive(Debug)]
struct ClaimedDevice {
    _locked: File,
    lock: PathBuf,
    stop: PathBuf,
}

impl Claim {
    /// Claims the robot at `wires` and removes earlier requests to stop it.
    ///
    /// # Errors
    /// If another process has it, or the files cannot be used.
    pub fn new(wires: &WiresConfig) -> Result<Self> {
        let claimed: Result<Vec<ClaimedDevice>> =
            DEVICES.iter().map(|device| ClaimedDevice::new(&device(wires))).collect();
        Ok(Self { devices: claimed? })
    }

    /// Whether a stop has been requested since the claim.
    pub fn is_told_to_stop(&self) -> bool {
        self.devices.iter().any(|device| device.stop.exists())
    }
}

impl ClaimedDevice {
    fn new(device: &str) -> Result<Self> {
        let (lock, stop) = (file(device, "lock"), file(device, "stop"));
        let locked = locked(&lock).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock => Error::other(format!(
                "another `etude` uses {device}; wait for it, or stop it with `etude robot stop`"
            )),
            _ => Error::other(format!("{}: {error}", lock.display())),
        })?;
        match std::fs::remove_file(&stop) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(Error::other(format!("{}: {error}", stop.display())))
            }
            _ => Ok(Self { _locked: locked, lock, stop }),
        }
    }
}

impl Drop for ClaimedDevice {
    /// Leaves no files behind.
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.stop);
        let _ = std::fs::remove_file(&self.lock);
    }
}

/// The locked file at `path`, which this process may have made.
fn locked(path: &Path) -> Result<File> {
    loop {
        let opened = match File::open(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                OpenOptions::new().write(true).create_new(true).open(path)
            }
            opened => opened,
        };
        // For other users, whatever the mask of this one; only the owner can and need do so.
        if let Ok(file) = &opened {
            let _ = file.set_permissions(Permissions::from_mode(0o666));
        }
        let file = match opened {
            // Another process was faster.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
            opened => opened?,
        };
        file.try_lock().map_err(Error::from)?;
        // The owner before may have removed the file between opening and locking.
        if std::fs::metadata(path).is_ok_and(|now| file.metadata().is_ok_and(|ours| ours.ino() == now.ino()))
        {
            return Ok(file);
        }
    }
}

/// Requests the process that has claimed the robot at `wires` to stop it and to end.
///
/// # Errors
/// If the files cannot be written.
pub fn tell_to_stop(wires: &WiresConfig) -> Result<()> {
    // The hand first: the name of an arm may have to be looked up in a network.
    for device in DEVICES {
        let stop = file(&device(wires), "stop");
        match OpenOptions::new().write(true).create_new(true).open(&stop) {
            // A request that is there already says the same.
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                return Err(Error::other(format!("{}: {error}", stop.display())));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The devices that move.
const DEVICES: [fn(&WiresConfig) -> String; 2] =
    [|wires| can::device(&wires.can), |wires| xarm::device(&wires.arm)];

fn file(device: &str, extension: &str) -> PathBuf {
    let folder = Path::new("/tmp/etude");
    if std::fs::create_dir(folder).is_ok() {
        // Whoever makes it makes it for everybody.
        let _ = std::fs::set_permissions(folder, Permissions::from_mode(0o777));
    }
    folder.join(format!("{}.{extension}", device.replace('-', "--").replace('/', "-")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wires(folder: &Path, can: &str, arm: &str) -> WiresConfig {
        let can = format!("bus:{}", folder.join(can).display());
        WiresConfig { can, arm: arm.to_string(), ..WiresConfig::default() }
    }

    #[test]
    fn a_device_is_claimed_once_whatever_rig_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |can, arm| wires(folder.path(), can, arm);
        let claim = Claim::new(&at("a", "127.0.0.1:61001:61002")).unwrap();
        for shared in [at("a", "127.0.0.1:61003:61004"), at("b", "127.0.0.1:61001:61002")] {
            let said = Claim::new(&shared).unwrap_err().to_string();
            assert!(said.contains("another `etude` uses"), "{said}");
        }
        // Neither device of the refused ones is kept.
        let other = Claim::new(&at("b", "127.0.0.1:61003:61004")).unwrap();
        tell_to_stop(&at("a", "127.0.0.1:61009:61010")).unwrap();
        tell_to_stop(&at("a", "127.0.0.1:61009:61010")).unwrap();
        assert!(claim.is_told_to_stop() && !other.is_told_to_stop());
        // One that was refused does not take the request away.
        assert!(Claim::new(&at("a", "127.0.0.1:61005:61006")).is_err());
        assert!(claim.is_told_to_stop());
        drop(claim);
        let again = Claim::new(&at("a", "127.0.0.1:61009:61010")).unwrap();
        assert!(!again.is_told_to_stop(), "what was requested before does not count");
        drop((again, other));
        let left = std::fs::read_dir("/tmp/etude")
            .unwrap()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let mark = folder.path().file_name().unwrap().to_string_lossy().replace('-', "--");
        assert_eq!(left.filter(|name| name.contains(&mark)).count(), 0);
    }
}
