//! `etude robot`: check, home, calibrate, monitor and stop a robot.

mod check;

use std::io::BufRead as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::ValueHint;
use etude_lab::released;
use etude_perform::prepare;
use etude_perform::session::{
    Claim, Guard, Session, TWIN, claim, pitches_to_show, ready, request_stop, rig_choice, run_guard,
    start_guard, start_pose, store_point, try_path,
};
use etude_robot::hand_guiding::{Guiding, HandGuidingError, read_pose};
use etude_robot::monitor::Monitor;
use etude_robot::priority::{Priority, Rank};
use etude_robot::rig_file::RigConfig;
use etude_robot::stop::stop;
use etude_twin::SHOWN_KEYS;
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGPIPE, SIGTERM};

use crate::args;
use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::stop_flag;

/// Advice if a running controller may not have received the request to stop.
const NOT_ASKED: &str = "a running controller could not be asked to stop: end the process of the running `etude` command (Ctrl-C in its \
                         terminal)";

/// The action.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Bring hand, arm and keyboard up, hold still for half a second, release, and print serial
    /// numbers, versions, temperature and position
    Check(check::Args),
    /// Move the robot slowly to the keyboard, fingers over the keys. Stand clear
    Home(RigArgs),
    /// Calibrate the keyboard's position, one key at a time
    Calibrate(Calibrate),
    /// Release the hand and stop the arm at once, also during a performance
    Stop(RigArgs),
    /// Print the reports of the devices without moving anything
    Monitor(MonitorArgs),
    /// Stop the robot when the controller at the other end of standard input has ended
    #[command(hide = true)]
    Guard(RigArgs),
}

#[derive(clap::Args)]
struct RigArgs {
    /// `twin`, or the file of a rig
    #[arg(long, value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
#[command(after_help = "\
Guide the hand until its middle finger is over the middle of the key, at playing height, and press Enter. \
Repeat this for all three keys; with --by-hand the arm can be guided by hand. The position is saved in the \
calibration file that the rig's file names, or beside it.

Examples:
  etude robot calibrate --robot lab.toml --at lowest --by-hand
  etude robot calibrate --robot lab.toml --at middle --by-hand
  etude robot calibrate --robot lab.toml --at highest --by-hand")]
struct Calibrate {
    /// The file of a rig
    #[arg(long, value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Which key the middle finger is over
    #[arg(long, value_enum)]
    at: CalibrationKey,
    /// Hand guiding: the arm can be moved by hand until Enter is pressed
    #[arg(long)]
    by_hand: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum CalibrationKey {
    /// The lowest C
    Lowest,
    /// The C in the middle
    Middle,
    /// The highest C
    Highest,
}

#[derive(clap::Args)]
struct MonitorArgs {
    /// The file of a rig
    #[arg(long, value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Duration, s; by default until Ctrl-C
    #[arg(long, value_parser = args::positive)]
    secs: Option<f64>,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    match args.action {
        Action::Check(args) => check::run(&args),
        Action::Home(rig) => home(&rig),
        Action::Calibrate(args) => calibrate(&args),
        Action::Stop(rig) => stop_now(&rig),
        Action::Monitor(args) => monitor(&args),
        Action::Guard(rig) => guard(&rig),
    }
}

/// The rig's file; an error for the twin in lockstep, which exists only during one command.
fn file(robot: &str) -> anyhow::Result<RigConfig> {
    if robot == TWIN {
        anyhow::bail!(
            "the twin of `--robot twin` exists only while one command runs; start a twin with `etude twin`"
        );
    }
    Ok(RigConfig::load(Path::new(robot))?)
}

fn home(rig: &RigArgs) -> anyhow::Result<VerbEnd> {
    let choice = rig_choice(&rig.robot, "standard")?;
    let interrupt = stop_flag()?;
    let pose = start_pose(choice.side())?;
    let mut session = choice.open(choice.side(), 0)?;
    let Session { robot, pace } = &mut session;
    let prepared = prepare(robot, pace, Some(&pose), None, &interrupt).map_err(Into::into);
    released(&mut session, prepared)?;
    let robot = &session.robot;
    let place = robot.place();
    if rig.json {
        print_json(&json!({ "rail_m": place.rail_m, "joints": robot.joints() }))?;
    } else {
        line(format!(
            "The hand is over the keys, {:+.3} m from the middle; the arm is at rest, the hand is released",
            place.rail_m
        ))?;
    }
    Ok(VerbEnd::Done)
}

fn calibrate(args: &Calibrate) -> anyhow::Result<VerbEnd> {
    let rig = file(&args.robot)?;
    let claim = claim(&rig)?;
    let index = args.at as usize;
    let key = SHOWN_KEYS[index];
    let pitch = etude_music::LOWEST_PITCH + key as u8;
    if args.by_hand {
        note(format!(
            "Guide the middle finger over key {pitch} ({}), then press Enter",
            ["the lowest C", "the middle C", "the highest C"][index]
        ));
    }
    let guard = start_guard(Path::new(&args.robot), &rig.wires)?;
    // `etude doctor` reports where this is not permitted.
    let _priority = Priority::of_this_thread(Rank::Controller).ok();
    let interrupt = stop_flag()?;
    // Only who guides the arm by hand presses Enter.
    let entered = if args.by_hand { enter(&interrupt) } else { channel().1 };
    let mut operator = Operator { guard, claim, entered, interrupt };
    let shown = read_pose(&rig, args.by_hand, &mut operator).inspect_err(|error| {
        if error.is_unreached() {
            operator.guard.farewell();
        }
    })?;
    // The arm has confirmed that it is at rest.
    operator.guard.farewell();
    if operator.interrupt.load(Ordering::Relaxed) {
        return Ok(VerbEnd::Stopped);
    }
    let calibration = store_point(&rig, key, &shown)?;
    line(format!("Key {pitch} is saved in {}", rig.calibration.display()))?;
    let left: Vec<String> = pitches_to_show(&calibration).iter().map(ToString::to_string).collect();
    if left.is_empty() {
        try_path(&rig, &calibration, &shown.joints_rad)?;
        line("All three keys are calibrated, and the arm reaches the whole keyboard")?;
    } else {
        line(format!("Still to calibrate: {}", left.join(", ")))?;
    }
    Ok(VerbEnd::Done)
}

/// The operator who guides the arm and presses Enter.
struct Operator {
    guard: Guard,
    claim: Claim,
    entered: Receiver<()>,
    interrupt: Arc<AtomicBool>,
}

impl Guiding for Operator {
    fn heartbeat(&mut self) -> Result<(), HandGuidingError> {
        if self.claim.is_stop_requested() {
            return Err(HandGuidingError::Stopped);
        }
        if self.guard.heartbeat() { Ok(()) } else { Err(HandGuidingError::Unguarded) }
    }

    fn is_guiding(&mut self) -> bool {
        self.entered.try_recv().is_err() && !self.interrupt.load(Ordering::Relaxed)
    }
}

/// Receives when a line was entered. If standard input ends, as that of a closed terminal does, the
/// operator is gone: that is an interruption.
fn enter(interrupt: &Arc<AtomicBool>) -> Receiver<()> {
    let interrupt = interrupt.clone();
    let (sender, entered) = channel();
    std::thread::spawn(move || {
        let mut text = String::new();
        match std::io::stdin().lock().read_line(&mut text) {
            Ok(1..) => drop(sender.send(())),
            Ok(0) | Err(_) => interrupt.store(true, Ordering::Relaxed),
        }
    });
    entered
}

fn stop_now(rig: &RigArgs) -> anyhow::Result<VerbEnd> {
    let config = file(&rig.robot)?;
    // A starting controller checks for this request before it moves the arm.
    let (requested, stopped) = std::thread::scope(|scope| {
        let requesting = scope.spawn(|| request_stop(&config.wires));
        let stopped = stop(&config);
        (requesting.join(), stopped)
    });
    let text = |result: &Result<(), String>| result.clone().err().unwrap_or_else(|| "stopped".to_string());
    if rig.json {
        print_json(
            &json!({ "hand": text(&stopped.hand), "arm": text(&stopped.arm), "sure": stopped.is_sure() }),
        )?;
    } else {
        line(format!("arm   {}", text(&stopped.arm)))?;
        line(format!("hand  {}", text(&stopped.hand)))?;
    }
    if !stopped.is_sure() {
        anyhow::bail!("not all devices confirmed the stop: use the hardware stop")
    }
    match requested {
        Ok(requested) => requested.context(NOT_ASKED)?,
        Err(_) => anyhow::bail!(NOT_ASKED),
    }
    Ok(VerbEnd::Done)
}

fn guard(rig: &RigArgs) -> anyhow::Result<VerbEnd> {
    // Signals that end the controller must not end its guard.
    let ignored = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP, SIGPIPE] {
        signal_hook::flag::register(signal, ignored.clone())?;
    }
    let config = file(&rig.robot)?;
    line(ready(&config.wires))?;
    if let Some(stopped) = run_guard(&config)? {
        note(
            "guard: the controller has ended or did not run for 70 ms (see the line `real time` of `etude doctor`)",
        );
        let is_sure = stopped.is_sure();
        for (what, result) in [("arm", stopped.arm), ("hand", stopped.hand)] {
            note(format!("guard: {what} {}", result.err().unwrap_or_else(|| "stopped".to_string())));
        }
        if !is_sure {
            anyhow::bail!("guard: not all devices confirmed the stop: use the hardware stop")
        }
    }
    Ok(VerbEnd::Done)
}

fn monitor(args: &MonitorArgs) -> anyhow::Result<VerbEnd> {
    let rig = file(&args.robot)?;
    // A serial adapter has one user: a second one would read its bytes and close its channel.
    let serial = rig.wires.can.starts_with("slcan:");
    let claimed = match claim(&rig) {
        Err(error) if serial => return Err(error.into()),
        claimed => claimed.ok(),
    };
    let mut monitor = Monitor::open(&rig, claimed.is_some()).context("the rig's keyboard")?;
    let _kept = claimed.filter(|_| serial);
    let stop = stop_flag()?;
    let begun = Instant::now();
    let mut next = Duration::ZERO;
    let over = |stop: &AtomicBool| {
        stop.load(Ordering::Relaxed) || args.secs.is_some_and(|secs| begun.elapsed().as_secs_f64() > secs)
    };
    while !over(&stop) {
        let now = begun.elapsed();
        monitor.poll(now);
        if now >= next {
            if !next.is_zero() {
                print_reports(&monitor, now, args.json)?;
            }
            next = now + Duration::from_millis(500);
            monitor.ask();
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(if stop.load(Ordering::Relaxed) { VerbEnd::Stopped } else { VerbEnd::Done })
}

fn print_reports(monitor: &Monitor, now: Duration, as_json: bool) -> anyhow::Result<()> {
    let seen = monitor.seen();
    let hand = report_json(&seen.hand, |(joints, information)| {
        json!({
            "joints_rad": joints,
            "board_celsius": information.map(|information| information.board_celsius),
            "servo_on": information.map(|information| information.status.servo_on()),
        })
    });
    let arm = report_json(&seen.arm, |report| {
        json!({
            "state": report.map(|report| report.state),
            "mode": report.map(|report| report.mode),
            "joints_rad": report.map(|report| report.joints_rad),
        })
    });
    let keys = report_json(&seen.keyboard, |bits| {
        let pressed: Vec<u8> = (0..49u8).filter(|key| bits >> key & 1 == 1).map(|key| 36 + key).collect();
        json!({ "pressed": pressed })
    });
    let all = json!({ "secs": now.as_secs_f64(), "hand": hand, "arm": arm, "keyboard": keys });
    if as_json {
        return line(all);
    }
    let short = |value: &serde_json::Value| match value["error"].as_str() {
        Some(error) => error.to_string(),
        None => value.to_string(),
    };
    line(format!("{:8.1} s  hand {}", now.as_secs_f64(), short(&hand)))?;
    line(format!("            arm {}", short(&arm)))?;
    line(format!("            keyboard {}", short(&keys)))
}

/// The report of a device, or its error.
fn report_json<T>(seen: &Result<T, String>, show: impl Fn(&T) -> serde_json::Value) -> serde_json::Value {
    seen.as_ref().map_or_else(|error| json!({ "error": error }), show)
}
