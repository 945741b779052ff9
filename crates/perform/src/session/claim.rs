//! The claim on a robot: only one process moves it, and any other can request it to stop.
//!
//! Claims and requests belong to the devices that move, not to the rig's file: a copy of the file
//! names the same robot. They are files in `/tmp/etude`, one for each device, which every user of
//! this machine may write. A program claims the robot before it does anything else and keeps it
//! until it ends. A request counts for every program that has begun before it, even if the program
//! claims the robot later: no request is lost. Its file stays, and means nothing to programs that
//! begin after it.

use std::fs::{File, OpenOptions, Permissions};
use std::io::{Error, ErrorKind, Result};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime};

use etude_robot::rig_file::WiresConfig;
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
    /// Requests from then on count.
    since: Beginning,
}

/// When a process began, by the clock and by a time that nobody sets.
#[derive(Clone, Copy, Debug)]
struct Beginning {
    clock: SystemTime,
    steady: Instant,
}

impl Beginning {
    fn now() -> Self {
        Self { clock: SystemTime::now(), steady: Instant::now() }
    }

    /// The beginning by the clock as it is set now, or as it was set then, if that is earlier.
    fn earliest(&self) -> SystemTime {
        SystemTime::now().checked_sub(self.steady.elapsed()).map_or(self.clock, |now| now.min(self.clock))
    }
}

/// When this process began.
static BEGAN: OnceLock<Beginning> = OnceLock::new();
/// Times of files may be this much before the clock. A program that begins after `etude robot stop`
/// has ended begins later than that.
const COARSE: Duration = Duration::from_millis(20);
/// A request that is further ahead of the clock was made before the clock was set back.
const AHEAD: Duration = Duration::from_secs(1);

/// Notes that this process begins now. Without it the process begins with its first claim.
pub fn process_begins() {
    BEGAN.get_or_init(Beginning::now);
}

impl Claim {
    /// Claims the robot at `wires`.
    ///
    /// # Errors
    /// If another process has it, or the files cannot be used.
    pub fn new(wires: &WiresConfig) -> Result<Self> {
        Self::since(wires, *BEGAN.get_or_init(Beginning::now))
    }

    /// The claim of a program that has begun at `began`.
    fn since(wires: &WiresConfig, began: Beginning) -> Result<Self> {
        let claimed: Result<Vec<ClaimedDevice>> =
            DEVICES.iter().map(|device| ClaimedDevice::new(&device(wires), began)).collect();
        Ok(Self { devices: claimed? })
    }

    /// Whether a stop has been requested since this process began.
    pub fn is_stop_requested(&self) -> bool {
        self.devices.iter().any(ClaimedDevice::is_stop_requested)
    }
}

impl ClaimedDevice {
    fn new(device: &str, since: Beginning) -> Result<Self> {
        let (lock, stop) = (file(device, "lock"), file(device, "stop"));
        let locked = locked(&lock).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock => Error::other(format!(
                "another `etude` uses {device}; wait for it, or stop it with `etude robot stop`"
            )),
            _ => Error::other(format!("{}: {error}", lock.display())),
        })?;
        Ok(Self { _locked: locked, lock, stop, since })
    }

    fn is_stop_requested(&self) -> bool {
        let requested = std::fs::metadata(&self.stop).and_then(|file| file.modified());
        let since = self.since.earliest() - COARSE;
        requested.is_ok_and(|at| at >= since && at <= SystemTime::now() + AHEAD)
    }
}

impl Drop for ClaimedDevice {
    fn drop(&mut self) {
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

/// Requests every process that controls the robot at `wires`, or has begun and will claim it, to
/// stop it and to end.
///
/// # Errors
/// If the files cannot be written.
pub fn request_stop(wires: &WiresConfig) -> Result<()> {
    // The hand first: the name of an arm may have to be looked up in a network.
    for device in DEVICES {
        let stop = file(&device(wires), "stop");
        // In one step, also over a file of another user.
        let new = stop.with_extension(format!("stop-{}", std::process::id()));
        let written = File::create(&new).and_then(|_| std::fs::rename(&new, &stop));
        written.map_err(|error| Error::other(format!("{}: {error}", stop.display())))?;
    }
    Ok(())
}

/// The devices that move.
const DEVICES: [fn(&WiresConfig) -> String; 2] =
    [|wires| can::device(&wires.can), |wires| xarm::device(&wires.arm)];

/// The file about a device that has this extension.
pub(super) fn file(device: &str, extension: &str) -> PathBuf {
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
        let before = Beginning::now();
        request_stop(&at("a", "127.0.0.1:61009:61010")).unwrap();
        request_stop(&at("a", "127.0.0.1:61009:61010")).unwrap();
        assert!(claim.is_stop_requested() && !other.is_stop_requested());
        // One that was refused does not take the request away.
        assert!(Claim::new(&at("a", "127.0.0.1:61005:61006")).is_err());
        assert!(claim.is_stop_requested());
        drop((claim, other));

        // It counts for a program that had begun before it and claims the robot only now, and for
        // no other.
        std::thread::sleep(2 * COARSE);
        let after = Beginning::now();
        // The clock was set back after this one had begun, by an hour.
        let ahead = Beginning { clock: before.clock + Duration::from_secs(3600), ..before };
        for (began, counts) in [(before, true), (after, false), (ahead, true)] {
            let again = Claim::since(&at("a", "127.0.0.1:61009:61010"), began).unwrap();
            assert_eq!(again.is_stop_requested(), counts);
        }
        // Nor does one from before the clock was set back.
        let again = Claim::since(&at("a", "127.0.0.1:61009:61010"), before).unwrap();
        let tomorrow = SystemTime::now() + Duration::from_secs(86_400);
        File::options().write(true).open(&again.devices[0].stop).unwrap().set_modified(tomorrow).unwrap();
        std::fs::remove_file(&again.devices[1].stop).unwrap();
        assert!(!again.is_stop_requested());
        std::fs::remove_file(&again.devices[0].stop).unwrap();
        drop(again);
        let left = std::fs::read_dir("/tmp/etude")
            .unwrap()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let mark = folder.path().file_name().unwrap().to_string_lossy().replace('-', "--");
        assert_eq!(left.filter(|name| name.contains(&mark)).count(), 0);
    }
}
