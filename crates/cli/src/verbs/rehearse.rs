//! `etude rehearse`: Sim2Real2Sim, from the first recording to the last performance.

use std::path::PathBuf;

use clap::ValueHint;
use clap::builder::PossibleValuesParser;
use etude_lab::{
    AdaptConfig, AdaptStep, Adapted, Iteration, Prediction, RehearsalConfig, RehearsalFit, RehearsalStep,
    RobotRun, RobotScores, RobotStep, SIGHT_READER, adapt_on_robot, adapted_before, best_iteration,
    find_song, policy_called, rehearse_on_robot, shipped_policy,
};
use etude_perform::session::{RigChoice, rig_choice};
use etude_perform::{Job, Mode, shell_word};
use etude_show::{REHEARSAL_PAGE, RehearsalPage};

use super::identify::fit_progress;
use super::perform::{lag_measured, run_summary};
use crate::args::{self, slug};
use crate::output::{VerbEnd, line, print_json};
use crate::progress::stop_flag;
use crate::status::Status;

/// The preset of the paper's own method, whose fit is the paper's too.
const PAPER: &str = "paper";

/// The song, the robot, and the number of iterations and performances.
#[derive(clap::Args)]
#[command(after_help = "\
Iteration 0 plays what was learned in the default simulator. Each later iteration records the robot (once), fits \
the simulator, trains the policy that has played best so far further in it, for the steps of the preset, and plays again. Best is the \
highest mean of F1 and onset F1. What is recorded and fitted depends on --fit. If it is stopped, the same command resumes it. With --preset sight-reader the trainings continue the sight-reader, for all songs: the robot plays SONG in each iteration. \
`etude perform` plays other songs with the best iteration's policy. Keep clear of the robot: it moves to the keyboard by itself before each run.

Examples:
  etude rehearse c-major-scale --robot twin --iterations 2
  etude rehearse twinkle --robot twin --twin-params worn --mode hybrid --iterations 1
  etude rehearse my-song.mid --robot lab.toml --iterations 3
  etude rehearse twinkle --simulator out/rehearse-c-major-scale/iteration-1/identified/identified.toml
  etude rehearse twinkle --robot twin --twin-params worn --iterations 0 --adapt 10
  etude rehearse twinkle --preset sight-reader --set trainer.total_steps=300000 --iterations 1
  etude rehearse twinkle --preset paper --iterations 3 --policy runs/twinkle-paper")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    song: String,
    /// Play a file's silence before its first note too
    #[arg(long)]
    keep_silence: bool,
    /// `twin`, or the file of a rig
    #[arg(long, default_value = "twin", value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Twin parameters (the hidden physical numbers of the twin): `standard`, `worn`, `mild`,
    /// `ideal`, `random:SEED`, or a file
    #[arg(long, default_value = "standard", value_name = "NAME|random:SEED|FILE", value_parser = args::twin_params(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    twin_params: String,
    /// Iterations of identifying, training and performing
    #[arg(long, default_value_t = 2)]
    iterations: usize,
    /// Performances an iteration
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    /// joint-mirroring, hybrid or real
    #[arg(long, default_value = "real")]
    mode: Mode,
    /// Preset of the trainings
    #[arg(long, default_value = etude_lab::DEFAULT_PRESET, value_name = "NAME", value_parser = PossibleValuesParser::new(etude_lab::presets()), hide_possible_values = true)]
    preset: String,
    /// Set a value of the trainings, for example --set task.randomisation.intensity=0.2; may be
    /// repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
    /// The first policy; the shipped one of the song, or with --preset sight-reader the
    /// sight-reader, if not given. Without any, it is learned first
    #[arg(long, value_name = "FILE|DIR")]
    policy: Option<PathBuf>,
    /// A simulator whose drives `etude identify` or another rehearsal has fitted to this robot
    /// (identified.toml); then only the keyboard is fitted
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    simulator: Option<PathBuf>,
    /// How the simulator is fitted. `bo`, the paper's: Bayesian optimisation, first on hand opening
    /// and closing, then on what was played too (the default of --preset paper). `lm`, ours:
    /// Levenberg-Marquardt on all excitations and slow presses of keys (the default). `none`: the
    /// same trainings in the unfitted simulator, to compare with
    #[arg(long, value_name = "lm|bo|none")]
    fit: Option<RehearsalFit>,
    /// End each fit of the identification after this many evaluations
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    evaluations: Option<u64>,
    /// After the iterations, learn on the robot itself for at most this many minutes of playing:
    /// the policy of iteration 0 plays in joint-mirroring, or in hybrid with --mode hybrid, and the
    /// joint errors and the wrongly played keys of a run correct the next run. At least three runs;
    /// homing and the performances at the end are not counted. With --iterations 0 nothing is
    /// fitted
    #[arg(long, value_name = "MINUTES", value_parser = args::positive)]
    adapt: Option<f64>,
    /// Seed of identification, of the twin's noise, and of the training unless --set says otherwise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Where everything goes; out/rehearse-SONG if not given, out/rehearse-sight-reader with that
    /// preset
    #[arg(short = 'o', long = "out", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print only one JSON array at the end: the iterations. The best one has the highest mean
    /// of robot_f1 and onset_f1. With --adapt, now or before, an object: iterations and adapted
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let song = find_song(&args.song, args.keep_silence)?;
    song.check_range()?;
    let name = slug(&args.song);
    let rig = rig_choice(&args.robot, &args.twin_params)?;
    let mut overrides = vec![format!("trainer.seed={}", args.seed)];
    overrides.extend(args.overrides);
    let has_corpus =
        etude_lab::resolve(&args.preset, args.simulator.as_deref(), &overrides)?.corpus.is_some();
    let learned = if has_corpus { SIGHT_READER.to_string() } else { name };
    let folder = args.out.unwrap_or_else(|| PathBuf::from("out").join(format!("rehearse-{learned}")));
    let fit = if args.preset == PAPER { RehearsalFit::Bo } else { RehearsalFit::Lm };
    let config = RehearsalConfig {
        song: args.song,
        rig: rig.name().to_string(),
        twin_params: match &rig {
            RigChoice::Twin(_) => Some(args.twin_params),
            RigChoice::File { .. } => None,
        },
        iterations: args.iterations,
        runs: args.runs.into(),
        mode: args.mode,
        preset: args.preset,
        overrides,
        policy: args.policy.as_deref().map(policy_called).transpose()?.or_else(|| shipped_policy(&learned)),
        simulator: args.simulator,
        fit: args.fit.unwrap_or(fit),
        evaluations: args.evaluations,
        seed: args.seed,
        threads: None,
    };
    let stop = stop_flag()?;
    let mut status = Status::new(args.json);
    let mut page = RehearsalPage::new(&config, &folder);
    let mut tell = |step: &RehearsalStep| {
        show(&mut status, step, &config);
        if let RehearsalStep::Iteration(iteration) = step {
            page.add(iteration);
        }
    };
    let iterations = rehearse_on_robot(&song, &rig, &config, &folder, &mut Job::new(&mut tell, &stop))?;
    let mut page = page.checked()?;
    let best = best_iteration(&iterations);
    let there = folder.join("adaptation");
    // The first policy, whatever plays best: one that was trained in a fitted simulator plays worse
    // in this way.
    let adapted = match (args.adapt, iterations.first()) {
        (Some(minutes), Some(first)) => {
            let adaptation = AdaptConfig {
                policy: first.policy.clone(),
                mode: mirrored(config.mode),
                minutes,
                runs: config.runs,
                seed: config.seed,
            };
            let mut tell = |step: &AdaptStep| show_adapting(&mut status, step, config.runs);
            Some(adapt_on_robot(&song, &rig, &adaptation, &there, &mut Job::new(&mut tell, &stop))?)
        }
        (None, Some(first)) => adapted_before(&there, &first.policy)?,
        _ => None,
    };
    if let Some(adapted) = &adapted {
        page.add_adapted(adapted);
    }
    drop(status);
    if args.json {
        match &adapted {
            Some(adapted) => {
                print_json(&serde_json::json!({ "iterations": iterations, "adapted": adapted }))?
            }
            None => print_json(&iterations)?,
        }
        page.checked()?;
        return Ok(VerbEnd::Done);
    }
    iterations.iter().map(iteration_summary).try_for_each(line)?;
    if let Some(adapted) = &adapted {
        print_adapted(adapted)?;
    }
    page.checked()?;
    line(format!("Read and listen: {}", folder.join(REHEARSAL_PAGE).display()))?;
    if let Some(best) = best {
        let adapted = adapted.filter(|adapted| adapted.scores.overall() > best.scores.overall());
        if adapted.is_none() && best.iteration + 1 < iterations.len() {
            line(format!("Iteration {} played best, not the last one: use its policy", best.iteration))?;
        }
        let twin_params = config
            .twin_params
            .as_ref()
            .map_or_else(String::new, |twin_params| format!(" --twin-params {}", shell_word(twin_params)));
        let how = match &adapted {
            Some(adapted) => {
                format!("--correction {}", shell_word(adapted.correction.display()))
            }
            None => format!(
                "--mode {} --policy {} --set task.plan.latency_compensation_secs={:.3}",
                config.mode,
                shell_word(best.policy.display()),
                best.scores.latency_compensation_secs
            ),
        };
        line(format!(
            "Play again with:  etude perform {} --robot {}{twin_params} {how}",
            shell_word(&config.song),
            shell_word(&args.robot)
        ))?;
    }
    Ok(VerbEnd::Done)
}

fn show(status: &mut Status, step: &RehearsalStep, config: &RehearsalConfig) {
    let part =
        |iteration: usize, what: &str| format!("iteration {iteration} of {}: {what}", config.iterations);
    match step {
        RehearsalStep::Recorded(excitation, [number, all]) => {
            status.now(&format!("recorded {excitation} ({number} of {all})"), "");
        }
        RehearsalStep::LeftOut { recording, why } => {
            status.done(&format!("warning: {} is not used for the fit: {why}", recording.display()));
        }
        RehearsalStep::Identifying(iteration, at) => {
            let [phase, state] = fit_progress(at);
            status.now(&part(*iteration, &format!("identifying, {phase}")), &state);
        }
        RehearsalStep::Training(iteration, at) => {
            let notes = at.best_notes.map_or_else(String::new, |notes| format!(", {notes}"));
            status.part(
                &part(*iteration, "training"),
                &format!(", step {} of {}{notes}, F1 {:.3}", at.step, at.total, at.best_f1.unwrap_or(0.0)),
                at.step as f64 / at.total as f64,
            );
        }
        RehearsalStep::Playing(iteration, RobotStep::RunEnded { index, run }) => {
            show_run(status, &part(*iteration, "playing"), index + 1, config.runs, run);
        }
        RehearsalStep::Playing(iteration, RobotStep::LagMeasured { run, latency_compensation_secs }) => {
            status.done(&format!("iteration {iteration}: {}", lag_measured(run, *latency_compensation_secs)));
        }
        RehearsalStep::Playing(_, RobotStep::Warning(warning)) => status.done(&format!("warning: {warning}")),
        RehearsalStep::Iteration(iteration) => status.done(&iteration_summary(iteration)),
    }
}

/// The mode of an adaptation, in which the robot follows simulated joints, after iterations in this
/// one.
fn mirrored(iterations: Mode) -> Mode {
    if iterations.has_simulation() { iterations } else { Mode::JointMirroring }
}

fn show_adapting(status: &mut Status, step: &AdaptStep, runs: usize) {
    match step {
        AdaptStep::Adapting(index, most, run) => status.part(
            "adapting",
            &format!(
                ", run {} of at most {most}, {}, F1 {:.3}; joint error: fingers {:.0} mrad, rail {:.1} mm",
                index + 1,
                run.scores.notes,
                run.scores.robot_f1,
                run.fingers_missed_rad * 1e3,
                run.rail_missed_m * 1e3
            ),
            (index + 1) as f64 / *most as f64,
        ),
        AdaptStep::Performing(RobotStep::RunEnded { index, run }) => {
            show_run(status, "adapted", index + 1, runs, run);
        }
        AdaptStep::Performing(RobotStep::Warning(warning)) => status.done(&format!("warning: {warning}")),
        // The lag is known by then.
        AdaptStep::Performing(RobotStep::LagMeasured { .. }) => {}
    }
}

/// Shows a run that has ended, of so many.
fn show_run(status: &mut Status, phase: &str, played: usize, runs: usize, run: &RobotRun) {
    let state = format!(", {played} of {runs} runs played, {}", run_summary(run));
    status.part(phase, &state, played as f64 / runs as f64);
}

fn print_adapted(adapted: &Adapted) -> anyhow::Result<()> {
    let by = match adapted.best {
        0 | 1 => "played without a correction: none was better".to_string(),
        runs => format!("with the correction after {runs} runs, the best of {}", adapted.adapting.len()),
    };
    line(format!(
        "adapted: {}, F1 {:.3} ± {:.3} in {}, {by}",
        adapted.scores.notes, adapted.scores.robot_f1, adapted.scores.robot_f1_std, adapted.mode
    ))
}

fn iteration_summary(iteration: &Iteration) -> String {
    let RobotScores { notes, lag_secs, sim_f1, robot_f1, robot_f1_std, gap, .. } = &iteration.scores;
    let late = lag_secs.map_or_else(String::new, |lag| format!(", {:+.0} ms late", lag * 1e3));
    let held_out = iteration.held_out_rad.map(|errors| errors.map(|rad| rad * 1e3));
    let held_out = held_out.map_or_else(String::new, |[before, after]| {
        format!("; held-out error of the fingers {before:.2} → {after:.2} mrad")
    });
    let predicted = iteration.prediction.map_or_else(String::new, |prediction| {
        let Prediction { before_fit_f1, after_fit_f1, played_f1 } = prediction;
        format!(
            "; of the policy before, F1 {before_fit_f1:.3} predicted before the fit, {after_fit_f1:.3} after it, {played_f1:.3} played"
        )
    });
    format!(
        "iteration {}: {notes} on the robot{late}; F1 {sim_f1:.3} in simulation, {robot_f1:.3} ± {robot_f1_std:.3} on the robot: \
         a gap of {:.1} %{held_out}{predicted}",
        iteration.iteration,
        100.0 * gap
    )
}
