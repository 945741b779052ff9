//! The emulated arm on sockets of this machine.

use std::time::{Duration, Instant};

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ArmPorts, ArmServer};

/// An emulator on free ports, with the time of the wall. The drivers' tests use it too.
pub struct ServedArm {
    pub server: ArmServer,
    pub emulator: ArmEmulator,
    begun: Instant,
}

impl ServedArm {
    pub fn new() -> Self {
        let server = ArmServer::bind(ArmPorts::FREE).unwrap();
        Self { server, emulator: ArmEmulator::new(ArmEmulatorConfig::default()), begun: Instant::now() }
    }

    /// Serves once, after a short sleep; the time then.
    pub fn serve(&mut self) -> Duration {
        std::thread::sleep(Duration::from_micros(500));
        self.server.serve_once(self.begun.elapsed(), &mut self.emulator);
        self.begun.elapsed()
    }
}
