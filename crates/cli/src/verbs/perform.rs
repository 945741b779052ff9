//! `etude perform`: play a song on a robot, or on its twin.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use etude_lab::{
    CorrectionFile, MeanNotes, Remedy, RobotPlay, RobotReport, RobotRun, RobotStep, TooFast, find_song,
    play_on_robot, readable, set_latency_compensation, slower_rail, slug, too_fast,
};
use etude_music::KeyScheduleRule;
use etude_music::sound::SoundFont;
use etude_perform::session::{RigChoice, rig_choice};
use etude_perform::{Ending as Played, Job, Mode, NoteCounts, gap, shell_line};
use etude_twin::OrderedFault;

use super::play::note_summary;
use crate::args::{self, PlayerArgs};
use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::stop_flag;
use crate::status::planner;

const DEFAULT_TWIN_PARAMS: &str = "standard";

/// Song, player, mode and robot.
#[derive(clap::Args)]
#[command(after_help = "\
Modes (paper, appendix): in joint-mirroring the policy observes the simulation, and the robot follows the simulated \
joints; hybrid is the same, but the policy observes the robot's keys; in real it observes the robot alone.

The twin is an emulated robot: its devices use the same bytes as the real ones, and a second simulated world that differs \
from the simulator (--twin-params) moves them. It runs faster than the wall clock, and the same seed gives the same recording. \
For a twin by the wall clock start `etude twin` in another terminal and give its rig.

A first run, which is not counted, measures the lag of the notes. In the other runs the commands are sent \
earlier by that time. There is no such run with --set task.plan.latency_compensation_secs=SECS, with \
--correction, or if the robot is not homed (--home).

Files, per run: run-N.mcap (observations, commands, measurements), .mid, .wav, .csv; and report.json, \
reference.wav (as written). They are in DIR/1 for the first performance, DIR/2 for the next: none is \
replaced, and one that failed or was interrupted keeps its folder. DIR/latest links to the last one with a complete run, which \
`replay`, `compare` and `render` take if they are given DIR.

Examples:
  etude perform twinkle --robot twin
  etude perform twinkle --mode hybrid --robot twin --runs 3 --json
  etude perform my-song.mid --policy runs/my-song__fast__0 --robot lab.toml
  etude perform twinkle --robot lab.toml --correction out/rehearse-twinkle/adaptation/correction.json")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    song: String,
    /// Play a file's silence before its first note too
    #[arg(long)]
    keep_silence: bool,
    /// joint-mirroring, hybrid or real; by default real, or with --correction its mode
    #[arg(long)]
    mode: Option<Mode>,
    /// The correction that `etude rehearse --adapt` has learned for this song on this robot
    /// (correction.json), with its policy
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, conflicts_with_all = ["policy", "scripted", "overrides"])]
    correction: Option<PathBuf>,
    /// `twin`, or the file of a rig
    #[arg(long, default_value = "twin", value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Twin parameters (the hidden physical numbers of the twin): `standard`, `worn`, `mild`,
    /// `ideal`, `random:SEED`, or a file
    #[arg(long, default_value = DEFAULT_TWIN_PARAMS, value_name = "NAME|random:SEED|FILE", value_parser = args::twin_params(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    twin_params: String,
    /// Inject a fault into the twin, as in `etude twin`; starting and homing take some ten seconds
    #[arg(long = "fault", value_name = "KIND[=VALUE]@SECS[+SECS]")]
    faults: Vec<OrderedFault>,
    /// Home first: move the robot slowly to the keyboard (a twin always does). Stand clear
    #[arg(long)]
    home: bool,
    /// Number of performances
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    /// Seed of the twin's noise; each run adds one
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    player: PlayerArgs,
    /// Folder of the numbered results; if not given out/SONG-MODE, with the player if it is not the
    /// best policy for the song, and the robot if it is not the default twin
    #[arg(short = 'o', long = "out", value_name = "DIR")]
    out: Option<PathBuf>,
    /// A SoundFont (.sf2) for the sound; a built-in piano tone if not given
    #[arg(long, value_name = "FILE")]
    soundfont: Option<PathBuf>,
    /// Print JSON: notes_right, notes_due, notes_wrong, onset_f1, onset_f1_without_lag, lag_secs,
    /// sim_f1, robot_f1, robot_f1_std, gap, runs, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let song = find_song(&args.song, args.keep_silence)?;
    song.check_range()?;
    // Opened first, so that no request to stop the robot is lost while a policy is loaded.
    let rig = with_faults(rig_choice(&args.robot, &args.twin_params)?, &args.faults)?;
    let learned = args.correction.as_deref().map(CorrectionFile::load).transpose()?;
    let mut planner = planner(args.json);
    let player = match &learned {
        Some(learned) => learned.player(&song, &rig)?,
        None => args.player.load(&args.song, &song, &mut planner)?,
    };
    let rig = rig.for_simulator(&player.config.task.params()?);
    let mode = mode(args.mode, learned.as_ref())?;
    let is_named = args.player.policy.is_some() || args.player.scripted || learned.is_some();
    if let Some(found) = too_fast(&song, &player, is_named, &rig.config().limits, &mut planner)? {
        note(format!("warning: {}", slower(&args, &found)));
    }
    let limits = slower_rail(&player, &rig.config().limits)?;
    if !limits.is_empty() {
        let limits = limits.join(", ");
        note(format!("warning: the policy has learned with a slower rail: set {limits} in {}", args.robot));
    }
    let font = args.soundfont.as_deref().map(SoundFont::load).transpose()?;
    let folder = args
        .out
        .clone()
        .unwrap_or_else(|| args::folder_of(&song, Path::new("out").join(folder_name(&args, mode, &rig))));
    let home = args.home || rig.is_twin();
    let play = RobotPlay {
        song: &song,
        player: &player,
        rig: &rig,
        mode,
        runs: args.runs.into(),
        home,
        seed: args.seed,
        measures_lag: home && learned.is_none() && !set_latency_compensation(&args.player.overrides),
        correction: learned.map(|learned| learned.correction),
        font: font.as_ref(),
    };
    let stop = stop_flag()?;
    let quiet = args.json;
    // Each once: before the robot plays, or at the end.
    let mut warned = BTreeSet::new();
    let mut tell = |step: &RobotStep| match step {
        RobotStep::Warning(warning) if warned.insert(warning.clone()) => note(format!("warning: {warning}")),
        RobotStep::Warning(_) => {}
        _ if quiet => {}
        RobotStep::LagMeasured { run, latency_compensation_secs } => {
            note(lag_measured(run, *latency_compensation_secs));
        }
        RobotStep::RunEnded { index, run } => {
            note(format!("run {}: {}, {}", index + 1, run_summary(run), run.ending));
        }
    };
    let report = play_on_robot(&play, Some(&folder), &mut planner, &mut Job::new(&mut tell, &stop))?;
    if args.json {
        print_json(&report)?;
    } else {
        print(&report, player.config.task.key_schedule.rule == KeyScheduleRule::Articulated)?;
    }
    let warnings = report.runs.iter().flat_map(|run| &run.warnings);
    for warning in warnings.filter(|warning| warned.insert((*warning).clone())) {
        note(format!("warning: {warning}"));
    }
    if let Some(why) = &report.not_played {
        anyhow::bail!(
            "run {} was not played: {why}; the report has the runs before it",
            report.runs.len() + 1
        );
    }
    match report.runs.last().map(|run| &run.ending) {
        Some(Played::Fault(fault)) => anyhow::bail!(
            "the performance ended with a fault: {fault}; remove the cause, then repeat the command"
        ),
        Some(Played::Complete) if report.runs.len() == play.runs => Ok(VerbEnd::Done),
        _ => {
            note(format!("stopped; the means are of the complete runs, of {} requested", play.runs));
            Ok(VerbEnd::Stopped)
        }
    }
}

/// What to do about a song that is too fast for the rig.
fn slower(args: &Args, found: &TooFast) -> String {
    let TooFast { notes_right, notes_due, lowered, remedy } = found;
    let why = format!(
        "within this rig's limits the simulation plays {notes_right} of {notes_due} notes right ({})",
        lowered.join(", ")
    );
    let (factor, right) = match remedy {
        Remedy::Slower(factor, right) => (factor, right),
        Remedy::Raise(group, right) => {
            return format!(
                "{why}, and no slower tempo helps; with the default limits of the {group} it plays {right}: \
                 leave them out of {}",
                args.robot
            );
        }
        Remedy::Nothing => {
            return format!("{why}, and no slower tempo helps: raise these limits in {}", args.robot);
        }
    };
    let stem = Path::new(&args.song).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let file = format!("{stem}-x{factor}.mid");
    let factor_text = factor.to_string();
    let mut arrange = vec!["etude", "songs", "arrange", &args.song, "--stretch", &factor_text, "-o", &file];
    arrange.extend(args.keep_silence.then_some("--keep-silence"));
    let mut play = vec!["etude".to_string(), "perform".to_string(), file.clone()];
    play.extend(["--robot".to_string(), args.robot.clone()]);
    play.extend(args.mode.iter().flat_map(|mode| ["--mode".to_string(), mode.to_string()]));
    play.extend(args.home.then(|| "--home".to_string()));
    play.extend(args.player.scripted.then(|| "--scripted".to_string()));
    let policy = args.player.policy.iter().map(|policy| policy.display().to_string());
    play.extend(policy.flat_map(|policy| ["--policy".to_string(), policy]));
    play.extend(args.player.overrides.iter().flat_map(|change| ["--set".to_string(), change.clone()]));
    format!(
        "{why}; {factor} times slower it plays {right}: `{}`, then `{}`",
        shell_line(arrange.into_iter().map(str::to_string)),
        shell_line(play)
    )
}

/// Name of the folder of a performance, if none is given: song and mode, and what differs from the
/// default player and robot. So no performance replaces one on another robot.
fn folder_name(args: &Args, mode: Mode, rig: &RigChoice) -> String {
    // The name of a parameter set, or its file.
    let set = &args.twin_params;
    let robot = match rig {
        RigChoice::File { .. } => slug(rig.name()),
        RigChoice::Twin(_) if set == DEFAULT_TWIN_PARAMS => String::new(),
        RigChoice::Twin(_) if set.starts_with("random:") => readable(set),
        RigChoice::Twin(_) => slug(&Path::new(set).file_stem().unwrap_or_default().to_string_lossy()),
    };
    let corrected = args.correction.iter().map(|_| "corrected".to_string());
    let faults = args.faults.iter().map(|fault| readable(&fault.to_string()));
    let others = [robot].into_iter().chain(corrected).chain(faults);
    performance_name(&args.player, &args.song, mode, others.filter(|part| !part.is_empty()))
}

/// The same from player, song, mode and the `others`.
pub(super) fn performance_name(
    player: &PlayerArgs,
    song: &str,
    mode: Mode,
    others: impl IntoIterator<Item = String>,
) -> String {
    let parts = [player.folder_name(song), mode.to_string()];
    parts.into_iter().chain(others).collect::<Vec<_>>().join("-")
}

/// The mode that was asked for, or that of the correction.
fn mode(asked: Option<Mode>, learned: Option<&CorrectionFile>) -> anyhow::Result<Mode> {
    match (asked, learned.map(|learned| learned.mode)) {
        (Some(asked), Some(learned)) if asked != learned => {
            anyhow::bail!(
                "the correction is for {learned}, in which it was learned, not for {asked}; omit --mode"
            )
        }
        (asked, learned) => Ok(asked.or(learned).unwrap_or(Mode::Real)),
    }
}

/// The same robot with these faults, which only a twin of this process can be ordered to have.
fn with_faults(rig: RigChoice, faults: &[OrderedFault]) -> anyhow::Result<RigChoice> {
    match rig {
        RigChoice::Twin(twin_params) => Ok(RigChoice::Twin(Box::new(twin_params.with_faults(faults)?))),
        RigChoice::File { .. } if !faults.is_empty() => {
            anyhow::bail!(
                "--fault is for --robot twin; a twin of another process gets it by `etude twin --fault`"
            )
        }
        rig => Ok(rig),
    }
}

/// Notes and F1 of a run.
pub(super) fn run_summary(run: &RobotRun) -> String {
    format!("{}, F1 {:.3}", NoteCounts::from(&run.scores.note), run.scores.frame.f1)
}

/// The result of the run that measures the lag of a robot's notes.
pub(super) fn lag_measured(run: &RobotRun, latency_compensation_secs: Option<f64>) -> String {
    let notes = NoteCounts::from(&run.scores.note);
    let found = latency_compensation_secs
        .map_or("no note is right without the lag, so it is unchanged".to_string(), |secs| {
            format!("{:.0} ms from now on", secs * 1e3)
        });
    format!("lag measurement (not counted): {notes}; latency compensation: {found}")
}

fn print(report: &RobotReport, is_articulated: bool) -> anyhow::Result<()> {
    let scores = &report.scores;
    line(format!(
        "{} played by {} on {}{}, {}",
        report.song,
        report.player,
        report.robot,
        report
            .twin_params
            .as_ref()
            .map_or_else(String::new, |twin_params| format!(" (twin parameters `{twin_params}`)")),
        report.mode
    ))?;
    if report.only_measuring {
        line(
            "The lag measurement ended early, so no counted run was played; remove the cause, then repeat the command",
        )?;
    }
    for (index, run) in report.runs.iter().enumerate() {
        line(format!("run {}: {}", index + 1, note_summary(&run.scores.note)))?;
    }
    if let Some(lag) = scores.lag_secs {
        let MeanNotes { onset_f1, onset_f1_without_lag: aligned, .. } = scores.notes;
        // No advice if the lag does not lower the score.
        let advice = scores.better_latency_compensation_secs().filter(|_| aligned > onset_f1);
        let advice = advice.map_or_else(String::new, |secs| {
            format!("; on time with --set task.plan.latency_compensation_secs={secs:.3}")
        });
        line(format!(
            "Onset F1 {onset_f1:.3}, aligned by the median lag {aligned:.3}; lag {:+.0} ms; latency compensation {:.0} ms{advice}",
            lag * 1e3,
            scores.latency_compensation_secs * 1e3,
        ))?;
    }
    line(format!("{:22} {:>9} {:>9} {:>9}", "by control step", "precision", "recall", "F1"))?;
    line(format!("{:22} {:>9} {:>9} {:>9.3}", "simulation alone", "", "", scores.sim_f1))?;
    for (index, run) in report.runs.iter().enumerate() {
        let frame = &run.scores.frame;
        let name = format!("{}, run {}", report.robot, index + 1);
        line(format!("{name:22} {:>9.3} {:>9.3} {:>9.3}", frame.precision, frame.recall, frame.f1))?;
    }
    let spread =
        if report.runs.len() > 1 { format!(" ± {:.3}", scores.robot_f1_std) } else { String::new() };
    let robot = &report.robot;
    if is_articulated {
        line(format!(
            "F1 (articulated plan) {:.3} in simulation, {:.3}{spread} on {robot}: a gap of {:.1} %",
            scores.sim_f1,
            scores.robot_f1,
            100.0 * scores.gap
        ))?;
    }
    let (sim_f1, robot_f1) = (scores.sim_robopianist_f1, scores.robot_robopianist_f1);
    line(format!(
        "F1 (RoboPianist's rule, the paper's) {sim_f1:.3} in simulation, {robot_f1:.3} on {robot}: a gap of {:.1} %",
        100.0 * gap(sim_f1, robot_f1)
    ))?;
    if let Some(before) = &report.uncompensated {
        line(format!(
            "Without that latency compensation: {}, F1 {:.3} (RoboPianist's rule) in one run",
            NoteCounts::from(&before.note),
            before.robopianist_f1
        ))?;
    }
    for run in &report.runs {
        let times = &run.timing;
        line(format!(
            "{} set-points clamped; {} of {} deadlines missed, {} commands late (worst {:.1} ms)",
            run.clamped, times.missed, times.commands, times.late, times.late_worst_ms
        ))?;
        if let Some(files) = &run.files {
            line(format!("Listen: {}   recording: {}", files.wav.display(), files.recording.display()))?;
        }
    }
    Ok(())
}
