//! A twin on sockets, by the wall clock: what `etude twin` runs, and what a controller in another
//! process plays on as if it were a rig.
//!
//! In its folder lie the sockets of the hand's bus and of the keyboard, the rig's file and its
//! calibration. The arm listens on free ports of this machine. Faults of the arm's link
//! (`[links.arm]`) are for [`Lockstep`] only; those that are ordered for a time (`[[faults]]`)
//! happen here as there.

use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use etude_emulators::faults::FaultKind;
use etude_emulators::{ArmPorts, ArmServer, MidiServer, ReportKind, VirtualBus};
use etude_robot::calibration::{CalibrationError, RailPath};
use etude_robot::can::{CanError, CanTransport as _, SlcanTransport};
use etude_robot::keyboard::MidiError;
use etude_robot::priority::{Priority, Rank};
use etude_robot::rig_file::{RigConfig, WiresConfig};
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Pace as _, propose_box};

use crate::hidden_params::STEP;
use crate::lockstep::Lockstep;
use crate::params::TwinParams;
use crate::twin::{Twin, TwinError, calibration};

/// Name of the rig and of its file.
const RIG: &str = "twin";
/// Longest delay of a twin that shares its machine with other programs, s; a real hand has no such
/// delays.
const HELD_UP_SECS: f64 = 0.05;
/// Longest time that is made up for after the machine was busy; the rest is lost, as if the world
/// had stood still.
const CATCH_UP: Duration = Duration::from_millis(50);

/// A twin could not be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// It could not be made.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// Its bus could not be opened.
    #[error(transparent)]
    Can(#[from] CanError),
    /// Its keyboard's socket could not be opened.
    #[error(transparent)]
    Midi(#[from] MidiError),
    /// Its calibration could not be written.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A file or a port could not be opened.
    #[error("{path}: {message}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        message: String,
    },
}

/// A twin on sockets.
pub struct TwinServer {
    lockstep: Lockstep,
    bus_server: VirtualBus,
    bus: SlcanTransport<UnixStream>,
    arm: ArmServer,
    /// `None`, and without a socket, while the keyboard is unplugged.
    midi: Option<MidiServer>,
    midi_path: PathBuf,
    rig: PathBuf,
    bytes: Vec<u8>,
    lost: Duration,
}

impl TwinServer {
    /// Opens the sockets of a twin in `folder` and writes the files by which it is found. `ports`
    /// are those of the arm.
    ///
    /// # Errors
    /// If the parameter set is not sound, or the folder or a port cannot be used.
    pub fn open(
        twin_params: &TwinParams,
        rig: &RigConfig,
        folder: &Path,
        ports: ArmPorts,
    ) -> Result<Self, ServeError> {
        let file = |path: &Path, message: String| ServeError::File { path: path.to_path_buf(), message };
        std::fs::create_dir_all(folder).map_err(|error| file(folder, error.to_string()))?;
        let folder = folder.canonicalize().map_err(|error| file(folder, error.to_string()))?;
        let lockstep = Lockstep::new(Twin::new(twin_params, rig.hand.side)?)?;
        let (can, midi) = (folder.join("can.sock"), folder.join("midi.sock"));
        let bus_server = VirtualBus::bind(&can)?;
        let bus = SlcanTransport::connect(&can)?;
        let outlet = MidiServer::bind(&midi)?;
        let port_error = |error: std::io::Error| file(Path::new("127.0.0.1"), error.to_string());
        let arm = ArmServer::bind(ports).map_err(port_error)?;
        let bound = arm.ports().map_err(port_error)?;
        let rig_path = folder.join(format!("{RIG}.toml"));
        let mut config = twin_params.fitting(RigConfig { name: RIG.to_string(), ..rig.clone() });
        config.wires = WiresConfig {
            can: format!("bus:{}", can.display()),
            arm: format!("127.0.0.1:{}:{}", bound.command, bound.of(ReportKind::Real)),
            midi: format!("midi:{}", midi.display()),
        };
        config.hand.stale_after_secs = config.hand.stale_after_secs.max(HELD_UP_SECS);
        config.calibration = PathBuf::from(format!("{RIG}.calibration.toml"));
        let mut place = calibration(RIG);
        let today = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        place.points.iter_mut().for_each(|point| point.shown_unix_secs = today);
        place.save(&folder.join(&config.calibration))?;
        let path = RailPath::new(&place, config.limits.rail_range_m, &PAPER_HOME_DEG.map(f64::to_radians))?;
        if config.arm.box_mm.is_none() {
            config.arm.box_mm = Some(
                propose_box(&path, config.limits.rail_range_m)
                    .map_err(|error| file(&rig_path, error.to_string()))?,
            );
        }
        let text = toml::to_string(&config).map_err(|error| file(&rig_path, error.to_string()))?;
        std::fs::write(&rig_path, text).map_err(|error| file(&rig_path, error.to_string()))?;
        Ok(Self {
            lockstep,
            bus_server,
            bus,
            arm,
            midi: Some(outlet),
            midi_path: midi,
            rig: rig_path,
            bytes: Vec::new(),
            lost: Duration::ZERO,
        })
    }

    /// The rig's file.
    pub fn rig(&self) -> &Path {
        &self.rig
    }

    /// The twin that it serves.
    pub fn twin(&self) -> &Twin {
        &self.lockstep.twin
    }

    /// Time that the world stood still because the machine was busy.
    pub fn lost(&self) -> Duration {
        self.lost
    }

    /// Serves until `stop` is set.
    ///
    /// # Errors
    /// If the bus breaks.
    pub fn serve(&mut self, stop: &AtomicBool) -> Result<(), ServeError> {
        // Hardware does not wait for other programs.
        let _priority = Priority::of_this_thread(Rank::Controller);
        let mut started = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let behind = started.elapsed().saturating_sub(self.lockstep.now());
            if behind > CATCH_UP {
                self.lost += behind;
                started += behind;
            }
            while self.lockstep.now() + STEP <= started.elapsed() {
                self.step()?;
            }
            std::thread::sleep((self.lockstep.now() + STEP).saturating_sub(started.elapsed()));
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), ServeError> {
        let now = self.lockstep.now();
        self.bus_server.set_off(self.lockstep.has(FaultKind::CanBusOff));
        self.bus_server.poll();
        loop {
            match self.bus.receive() {
                // A link that is cut takes nothing.
                Ok(Some(frame)) => drop(self.lockstep.wires().send_frame(frame)),
                // The twin is at the other end of a bus whose controller is off.
                Ok(None) | Err(CanError::Off { .. }) => break,
                Err(error) => return Err(error.into()),
            }
        }
        let is_disconnected = self.lockstep.has(FaultKind::ArmDisconnect);
        let arm = &mut self.lockstep.twin.devices.arm;
        if is_disconnected {
            self.arm.refuse_once(now, arm);
        } else {
            self.arm.serve_once(now, arm);
        }
        self.lockstep.step_apart_from_the_arm();
        let wires = self.lockstep.wires();
        while let Ok(Some(frame)) = wires.next_frame() {
            match self.bus.send(frame) {
                Ok(()) | Err(CanError::Off { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        self.bus_server.poll();
        self.bytes.clear();
        match (wires.receive_midi(&mut self.bytes), &mut self.midi) {
            (Ok(()), Some(midi)) => midi.send(&self.bytes),
            (Ok(()), None) => self.midi = Some(MidiServer::bind(&self.midi_path)?),
            (Err(_), _) => self.midi = None,
        }
        Ok(())
    }
}
