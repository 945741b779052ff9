//! How hot the motors of a hand were when a program ended, for the next program. The file lies
//! beside the claim on the hand.

use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use etude_robot::allegro::WIRE_JOINTS;
use etude_robot::rig_file::WiresConfig;
use etude_robot::{MotorHeat, can};
use serde::{Deserialize, Serialize};

use super::claim::file;
use crate::files::write_file;

/// The file of one hand.
#[derive(Debug)]
pub(super) struct HeatFile(PathBuf);

#[derive(Serialize, Deserialize)]
struct Kept {
    unix_secs: f64,
    joints: [f64; WIRE_JOINTS],
}

impl HeatFile {
    /// That of the hand at `wires`.
    pub fn new(wires: &WiresConfig) -> Self {
        Self(file(&can::device(&wires.can), "heat"))
    }

    /// How hot the motors are now, which is `now` on the robot's clock; cold if the file is
    /// missing, damaged or from the future.
    pub fn read(&self, now: Duration) -> MotorHeat {
        self.read_at(now, SystemTime::now()).unwrap_or_default()
    }

    fn read_at(&self, now: Duration, clock: SystemTime) -> Option<MotorHeat> {
        let kept: Kept = serde_json::from_slice(&std::fs::read(&self.0).ok()?).ok()?;
        let written = UNIX_EPOCH.checked_add(Duration::try_from_secs_f64(kept.unix_secs).ok()?)?;
        let age = clock.duration_since(written).ok()?;
        let then = MotorHeat::new(Duration::ZERO, kept.joints)?;
        MotorHeat::new(now, then.joints(age))
    }

    /// Keeps how hot the motors are at `now`. Without the file, the next program takes them for
    /// cold.
    pub fn write(&self, now: Duration, motor_heat: &MotorHeat) {
        self.write_at(motor_heat.joints(now), SystemTime::now());
    }

    fn write_at(&self, joints: [f64; WIRE_JOINTS], clock: SystemTime) {
        let unix_secs = clock.duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
        let text = serde_json::to_string(&Kept { unix_secs, joints }).expect("plain numbers");
        let _ = write_file(&self.0, &text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motors_cool_down_from_one_program_to_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let file = HeatFile(folder.path().join("hand.heat"));
        let (then, now) = (UNIX_EPOCH + Duration::from_secs(1_800_000_000), Duration::from_secs(7));
        let after = |secs: f64| file.read_at(now, then + Duration::from_secs_f64(secs));
        assert_eq!(after(0.0), None, "no file");
        let joints = std::array::from_fn(|joint| joint as f64 / 16.0);
        file.write_at(joints, then);
        // Times are kept to a microsecond or so.
        assert_eq!(file.read_at(now, then - Duration::from_secs(1)), None, "from the future");
        for (secs, left) in [(0.001, 1.0), (10.0, (-1.0f64).exp())] {
            let read = after(secs).unwrap().joints(now);
            let close = |(read, kept): (&f64, f64)| (read - kept * left).abs() < 2e-4;
            assert!(read.iter().zip(joints).all(close), "{read:?} after {secs} s");
        }
        let text = std::fs::read_to_string(&file.0).unwrap();
        let damaged = [
            text[..text.len() / 2].to_string(),
            text.replace("0.9375", "9.375"),
            text.replace("0.9375", "-0.9375"),
            text.replace("0.9375", "0.9375,0.1"),
            text.replace("1800000000.0", "-1e300"),
            String::new(),
        ];
        for damaged in damaged {
            assert_ne!(damaged, text);
            std::fs::write(&file.0, &damaged).unwrap();
            assert_eq!(after(1.0), None, "{damaged}");
        }
        std::fs::write(&file.0, text).unwrap();
        assert!(after(1.0).is_some());
    }
}
