//! `etude robot check`: brings a robot up, with --joints turns each joint of its hand a little, and
//! prints serial numbers, versions, temperature and position.

use std::sync::atomic::Ordering;
use std::time::Duration;

use etude_lab::released;
use etude_perform::session::{Session, rig_choice};
use etude_robot::{JOINTS_CHECKED, JointCheck, check_joints};
use serde_json::json;

use super::RigArgs;
use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::stop_flag;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    rig: RigArgs,
    /// Also turn each joint of the hand by 0.065 rad and back, one after the other, and check that
    /// it follows; the arm does not move
    #[arg(long)]
    joints: bool,
}

pub fn run(args: &Args) -> anyhow::Result<VerbEnd> {
    let rig = &args.rig;
    let interrupt = stop_flag()?;
    let choice = rig_choice(&rig.robot, "standard")?;
    let safety_box = choice.missing_box()?;
    let mut session = choice.open_at_rest(choice.side(), 0)?;
    let held = session.hold(Duration::from_millis(500), &interrupt).map_err(Into::into);
    let checked = held.and_then(|fault| match fault {
        None if args.joints => {
            let Session { robot, pace } = &mut session;
            let found = check_joints(robot, pace, &interrupt)?;
            Ok((robot.fault().map(ToString::to_string), Some(found)))
        }
        fault => Ok((fault, None)),
    });
    let (fault, mut checked) = released(&mut session, checked)?;
    let is_stopped = interrupt.load(Ordering::Relaxed);
    if is_stopped && let Some(found) = &mut checked {
        // The joint that was being turned had no time to follow.
        found.pop_if(|joint| joint.problem().is_some());
    }
    let robot = &session.robot;
    let (hand, arm, place) = (robot.hand().information(), robot.arm(), robot.place());
    let link = arm.link_speed();
    let version = arm.version().map(|version| version.text.clone());
    let report = json!({
        "rig": robot.config().name,
        "hand": {
            "serial": robot.hand().serial().map(|serial| serial.to_string()),
            "firmware": hand.map(|hand| hand.firmware),
            "board_celsius": hand.map(|hand| hand.board_celsius),
            "joints_rad": robot.hand().positions(),
        },
        "arm": {
            "serial": arm.serial(),
            "firmware": version,
            "joints_rad": arm.joints(),
            "replies_within_secs": link.reply.map(|reply| reply.as_secs_f64()),
            "targets_per_second": link.hz,
        },
        "rail": { "m": place.rail_m, "beside_m": place.beside_m, "turned_rad": place.turned_rad },
        "keyboard": robot.keyboard().state().to_string(),
        "warnings": robot.warnings(),
        "missing_box": safety_box,
        "joints": checked.as_deref().map(joints),
        "fault": fault,
    });
    if rig.json {
        print_json(&report)?;
    } else {
        let text = |value: &serde_json::Value| value.as_str().unwrap_or("unknown").to_string();
        let (hand, arm) = (&report["hand"], &report["arm"]);
        line(format!("hand      {}, board {} °C", text(&hand["serial"]), hand["board_celsius"]))?;
        line(format!("arm       {}, firmware {}", text(&arm["serial"]), text(&arm["firmware"])))?;
        line(format!("link      {link}"))?;
        line(format!(
            "position  {:+.3} m along the keyboard, {:.0} mm from the calibrated path",
            place.rail_m,
            place.beside_m * 1e3
        ))?;
        line(format!("keyboard  {}", text(&report["keyboard"])))?;
        for warning in robot.warnings() {
            line(format!("warning   {warning}"))?;
        }
        if let Some(safety_box) = safety_box {
            line(format!(
                "box       none yet; a suitable one for the rig's file, under [arm]: {safety_box}"
            ))?;
        }
        for joint in checked.iter().flatten() {
            line(format!(
                "joint {:2}  sent {:+.3} rad, turned {:+.3} rad{}",
                joint.joint,
                joint.sent_rad,
                joint.turned_rad,
                joint.problem().map(|problem| format!(": {problem}")).unwrap_or_default()
            ))?;
        }
    }
    if is_stopped {
        if let Some(fault) = fault {
            note(format!("safety stop: {fault}; remove the cause, then repeat the command"));
        }
        return Ok(VerbEnd::Stopped);
    }
    let found = checked.unwrap_or_default();
    let wrong = found.iter().filter_map(|joint| Some(format!("joint {} {}", joint.joint, joint.problem()?)));
    let wrong: Vec<String> = wrong.collect();
    match fault {
        _ if !wrong.is_empty() => {
            let stopped = fault.map(|fault| format!("; safety stop: {fault}"));
            anyhow::bail!("{}{}", wrong.join("; "), stopped.unwrap_or_default())
        }
        Some(fault) => {
            anyhow::bail!("safety stop: {fault}; remove the cause, then repeat the command")
        }
        None if args.joints && found.len() < JOINTS_CHECKED => {
            anyhow::bail!("stopped after {} of {JOINTS_CHECKED} joints", found.len())
        }
        None => Ok(VerbEnd::Done),
    }
}

fn joints(found: &[JointCheck]) -> serde_json::Value {
    let joint = |joint: &JointCheck| {
        json!({
            "joint": joint.joint,
            "sent_rad": joint.sent_rad,
            "turned_rad": joint.turned_rad,
            "problem": joint.problem(),
        })
    };
    found.iter().map(joint).collect()
}
