//! The scripted baseline on every song of the repertoire: a table of scores and what limits each
//! song.
//!
//! `scripted` prints the table, `scripted lag` the lags and velocities of strikes of several
//! depths, `scripted detail ID` the strikes and releases of one song.
#![allow(clippy::print_stdout)] // An example talks to the terminal.

use std::error::Error;
use std::sync::atomic::AtomicBool;

use etude_music::{CONTROL_HZ, LOWEST_PITCH, pitch_name, repertoire};
use etude_perform::{Performance, Scores, SimRig};
use etude_stage::geometry::{KeyShape, key_target};
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::{RAIL, World, kinematics};
use etude_task::{Piece, ScriptedBaseline, TaskConfig, TaskError};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let config = TaskConfig::default();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => table(&config),
        ["lag"] => lag(&config),
        ["detail", id] => detail(&config, id),
        _ => Err("usage: scripted [lag | detail ID]".into()),
    }
}

fn play(config: &TaskConfig, id: &str) -> Result<(ScriptedBaseline, Performance), Box<dyn Error>> {
    let song = repertoire::get(id).ok_or("no such song")?;
    let piece = Piece::for_task(&song, config)?;
    let mut player = ScriptedBaseline::new(config, &piece)?;
    let mut rig = SimRig::nominal(config, &piece)?;
    let never = AtomicBool::new(false);
    let performance = etude_perform::perform(&mut rig, &mut player, config, &piece, None, &never)?;
    Ok((player, performance))
}

fn table(config: &TaskConfig) -> Result<(), Box<dyn Error>> {
    println!(
        "{:18} {:>6} {:>9} {:>6} {:>8} {:>6}  limits",
        "song", "f1", "precision", "recall", "onset_f1", "free"
    );
    for id in repertoire::ids() {
        let (player, performance) = play(config, id)?;
        let Scores { frame, note, .. } = performance.scores();
        println!(
            "{id:18} {:6.3} {:9.3} {:6.3} {:8.3} {:6.3}  {}",
            frame.f1,
            frame.precision,
            frame.recall,
            note.onset_f1,
            performance.simulation.unwrap_or_default().collision_free,
            player.unplayed()
        );
    }
    Ok(())
}

fn detail(config: &TaskConfig, id: &str) -> Result<(), Box<dyn Error>> {
    let (player, performance) = play(config, id)?;
    for limit in &player.unplayed().notes {
        println!("{limit}");
    }
    for (step, (due, pressed)) in performance.piece.frames().iter().zip(&performance.pressed).enumerate() {
        if due != pressed {
            println!("step {step}: due {due}, pressed {pressed}");
        }
    }
    for event in &performance.events {
        let what = if event.velocity > 0 { "down" } else { "up" };
        let name = pitch_name(LOWEST_PITCH + event.key as u8);
        println!("{name:4} {what:4} step {:.1} velocity {}", event.secs * CONTROL_HZ, event.velocity);
    }
    Ok(())
}

/// Times from a change of target to the key's threshold, and the strike's velocity, for one finger
/// over one key.
fn lag(config: &TaskConfig) -> Result<(), Box<dyn Error>> {
    let params = config.params()?;
    let mut world = World::new(&config.stage, &params).map_err(TaskError::from)?;
    const FINGER: usize = 1;
    let strikes = [24, 25].into_iter().flat_map(|key| {
        // Clearances of the waiting fingertip, m.
        let over = [0.001, 0.006].into_iter();
        over.flat_map(move |hover| [0.7, 0.8, 1.0, 1.2, 1.5, 2.5].map(|depth| (key, hover, depth)))
    });
    for (key, hover, depth) in strikes {
        let shape = KeyShape::of(key);
        let [x, y, _] = key_target(key);
        let travel = shape.max_angle() * (x - shape.x + shape.size[0] / 2.0);
        let top = shape.top() + TIP_RADIUS;
        world.reset();
        let mut pose = world.start_pose();
        pose[RAIL] = y;
        let angles =
            |z: f64| kinematics::reach(config.stage.side, FINGER, [x, y, z], y).ok_or("out of reach");
        let slots = FINGER * JOINTS_PER_FINGER..(FINGER + 1) * JOINTS_PER_FINGER;
        let (up, down) = (angles(top + hover)?, angles(top - depth * travel)?);
        pose[slots.clone()].copy_from_slice(&up);
        world.reset_to(&pose);
        let (mut times, mut struck) = ([f64::NAN; 2], 0);
        for (time, target) in times.iter_mut().zip([down, up]) {
            let begin = world.time_secs();
            pose[slots.clone()].copy_from_slice(&target);
            for _ in 0..20 {
                world.step(&pose);
                if let Some(event) = world.events().iter().find(|event| event.key == key) {
                    *time = (event.secs - begin) * 1e3;
                    struck = struck.max(event.velocity);
                }
            }
        }
        println!(
            "{:4} from {:.0} mm above, depth {depth}: strike after {:.0} ms with velocity {struck}, release after {:.0} ms",
            pitch_name(LOWEST_PITCH + key as u8),
            1e3 * hover,
            times[0],
            times[1]
        );
    }
    for distance in [0.01, 0.0232, 0.0465, 0.1, 0.2] {
        world.reset();
        let mut pose = world.start_pose();
        pose[RAIL] = distance;
        print!("rail {:3.0} mm, % of the way after each control step:", distance * 1e3);
        for _ in 0..14 {
            world.step(&pose);
            print!(" {:.0}", world.joints()[RAIL] / distance * 100.0);
        }
        println!();
    }
    Ok(())
}
