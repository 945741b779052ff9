//! The commands of a recording.

use etude_perform::{Activity, Recording};
use etude_robot::rig_file::SETPOINT_HZ;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS};

/// The commands of a motion.
#[derive(Clone, Debug, PartialEq)]
pub enum Commands {
    /// Joint targets, one a control step.
    Targets(Vec<[f64; DRIVEN_JOINTS]>),
    /// Set-points, one a physics step.
    SetPoints(Vec<[[f64; DRIVEN_JOINTS]; PHYSICS_STEPS]>),
}

impl Commands {
    /// Control steps.
    pub fn steps(&self) -> usize {
        match self {
            Self::Targets(targets) => targets.len(),
            Self::SetPoints(points) => points.len(),
        }
    }
}

fn joint_vector(values: &[f64]) -> Result<[f64; DRIVEN_JOINTS], String> {
    let found =
        <[f64; DRIVEN_JOINTS]>::try_from(values).ok().filter(|values| values.iter().all(|v| v.is_finite()));
    found
        .ok_or_else(|| "a command in it does not have one number for each joint; record it again".to_string())
}

/// The commands of every complete control step.
pub(super) fn commands(recording: &Recording) -> Result<Commands, String> {
    let mirrored = matches!(recording.header.activity, Activity::Mode(mode) if mode.has_simulation());
    let played = recording.steps.len();
    if recording.targets.is_empty() {
        return Err("it has no commands: it is of a robot at rest, or of a simulation; record an \
                    excitation (`etude record --excitation chirp`) or a performance"
            .to_string());
    }
    if !mirrored {
        let targets = recording.targets.iter().take(played).map(|message| joint_vector(&message.targets));
        return Ok(Commands::Targets(targets.collect::<Result<_, _>>()?));
    }
    // The set-point after physics step n is the target of that step.
    let mut points = vec![None; played * PHYSICS_STEPS];
    for (secs, point) in &recording.setpoints {
        let index = (secs * SETPOINT_HZ).round();
        if index >= 1.0
            && let Some(slot) = points.get_mut(index as usize - 1)
        {
            *slot = Some(joint_vector(&point.sent)?);
        }
    }
    let mut last = None;
    let filled: Option<Vec<_>> = points
        .into_iter()
        .map(|point| {
            last = point.or(last);
            last
        })
        .collect();
    let filled = filled.ok_or("its first set-points are missing; record it again")?;
    let (steps, _) = filled.as_chunks::<PHYSICS_STEPS>();
    Ok(Commands::SetPoints(steps.to_vec()))
}
