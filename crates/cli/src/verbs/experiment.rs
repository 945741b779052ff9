//! `etude experiment`: every experiment of the paper, on a laptop or a cluster.

use std::path::{Path, PathBuf};

use clap::{Subcommand, ValueEnum, ValueHint};
use etude_experiment::{
    Experiment, ExperimentConfig, Launch, LocalConfig, SlurmConfig, Trial, TrialEnd, TrialProgress,
    TrialState, WorkEstimate, launch_local, names, open_trials, plan_file, plan_text, read_plan, run_trial,
    slurm_script, submit, write_plan,
};
use etude_perform::{Job, shell_line};
use serde_json::json;

use crate::args;
use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::{is_attended, patient_stop_flag, stop_flag};
use crate::status::{Status, clock};

/// What to do with experiments.
#[derive(clap::Args)]
#[command(after_help = "\
An experiment is a TOML file (configs/experiments; a path works too). Its plan is a list of trials. A trial's id depends only on what \
is done: experiments share common trials, a trial that is done is not done again, and a trial that was stopped is resumed. \
To merge results of several machines, copy the folders of trials.

Examples:
  etude experiment list
  etude experiment run songs
  etude experiment run randomisation --launcher slurm --throttle 20 --sbatch=--partition=short
  etude experiment status songs
  etude experiment report songs fences -o out/experiments")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// List the experiments that come with Étude
    List {
        /// Print JSON instead
        #[arg(long)]
        json: bool,
    },
    /// Print the trials of an experiment, one JSON object a line
    Plan(PlanArgs),
    /// Do the trials that are not done yet
    Run(RunArgs),
    /// Print the state of the trials
    Status(StatusArgs),
    /// Make tables, figures and one page from the results
    Report(ReportArgs),
    /// Do one trial of a plan; the launchers call this
    #[command(hide = true)]
    Trial(TrialArgs),
}

#[derive(clap::Args)]
struct PlanArgs {
    /// Names of experiments, or TOML files
    #[arg(required = true, value_name = "NAME|FILE", value_parser = args::NameOrPath(etude_experiment::names), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    names: Vec<String>,
    /// This many seeds instead of the file's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: Option<u64>,
    /// Size of the experiment
    #[arg(long, value_enum, default_value = "full")]
    budget: Budget,
    /// Set a value of every training, for example --set trainer.total_steps=1e6; may be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Budget {
    /// All trials of the file
    Full,
    /// Everything once and as short as possible, as a test
    Smoke,
}

impl PlanArgs {
    fn config(&self) -> ExperimentConfig {
        ExperimentConfig { seeds: self.seeds, smoke: self.budget == Budget::Smoke, set: self.set.clone() }
    }

    fn plans(&self) -> anyhow::Result<Vec<(Experiment, Vec<Trial>)>> {
        let config = self.config();
        let plan = |name: &String| {
            let experiment = Experiment::load(name)?;
            let trials = experiment.plan(&config)?;
            Ok((experiment, trials))
        };
        self.names.iter().map(plan).collect()
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Launcher {
    /// Processes on this machine
    Local,
    /// A job array
    Slurm,
}

#[derive(clap::Args)]
struct RunArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Where the folders of trials are
    #[arg(long, default_value = "runs", value_name = "DIR")]
    runs_dir: PathBuf,
    /// Where the trials run
    #[arg(long, value_enum, default_value = "local")]
    launcher: Launcher,
    /// Local: number of trials at a time; one a core if not given
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..), value_name = "N")]
    workers: Option<u16>,
    /// Threads of a trial
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..), value_name = "N")]
    threads: u16,
    /// Slurm: largest number of trials at a time
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..), value_name = "N")]
    throttle: Option<u16>,
    /// Slurm: time limit of a trial; a trial that needs longer saves its state and is requeued
    #[arg(long, default_value = "04:00:00", value_name = "TIME")]
    time: String,
    /// Slurm: an option of sbatch, as your site asks for it, for example
    /// --sbatch=--partition=short; may be repeated
    #[arg(long = "sbatch", value_name = "OPTION", allow_hyphen_values = true)]
    sbatch: Vec<String>,
    /// Start nothing: print how much there is to do and how long it takes here; Slurm: the script
    #[arg(long)]
    dry_run: bool,
}

#[derive(clap::Args)]
struct StatusArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Where the folders of trials are
    #[arg(long, default_value = "runs", value_name = "DIR")]
    runs_dir: PathBuf,
    /// Print JSON instead
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
struct ReportArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Where the folders of trials are
    #[arg(long, default_value = "runs", value_name = "DIR")]
    runs_dir: PathBuf,
    /// Folder of the page. Results of an earlier report in it are used too, so the page can be made
    /// again without the runs
    #[arg(short = 'o', long = "out", default_value = "out/experiments", value_name = "DIR")]
    out: PathBuf,
}

#[derive(clap::Args)]
struct TrialArgs {
    /// The plan
    plan: PathBuf,
    /// Line of the plan, counted from 0
    index: usize,
    /// Where the folders of trials are
    #[arg(long, default_value = "runs", value_name = "DIR")]
    runs_dir: PathBuf,
    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: usize,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    match args.what {
        What::List { json } => list(json),
        What::Plan(args) => {
            for (_, trials) in args.plans()? {
                line(plan_text(&trials).trim_end())?;
            }
            Ok(VerbEnd::Done)
        }
        What::Run(args) => launch(&args),
        What::Status(args) => status(&args),
        What::Report(args) => report(&args),
        What::Trial(args) => trial(&args),
    }
}

fn list(as_json: bool) -> anyhow::Result<VerbEnd> {
    let mut rows = Vec::new();
    for name in names() {
        let experiment = Experiment::load(name)?;
        let trials = experiment.plan(&ExperimentConfig::default())?.len();
        rows.push(
            json!({ "name": name, "trials": trials, "title": experiment.title, "source": experiment.source }),
        );
        if !as_json {
            line(format!("{name:<16}{trials:>5} trials  {}", experiment.title))?;
        }
    }
    if as_json {
        print_json(&rows)?;
    }
    Ok(VerbEnd::Done)
}

fn launch(args: &RunArgs) -> anyhow::Result<VerbEnd> {
    let plans = args.plan.plans()?;
    let trials: Vec<Trial> = plans.iter().flat_map(|(_, trials)| trials.clone()).collect();
    let name = plans.iter().map(|(experiment, _)| experiment.name.as_str()).collect::<Vec<_>>().join("-");
    let plan = plan_file(&args.runs_dir, &name, &trials);
    let program = std::env::current_exe()?;
    match args.launcher {
        Launcher::Local => local(args, &trials, &plan, program),
        Launcher::Slurm => slurm(args, &name, &trials, &plan, program),
    }
}

fn local(args: &RunArgs, trials: &[Trial], plan: &Path, program: PathBuf) -> anyhow::Result<VerbEnd> {
    if args.throttle.is_some() || !args.sbatch.is_empty() {
        anyhow::bail!("--throttle and --sbatch are for the cluster: add --launcher slurm");
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = usize::from(args.threads);
    let workers = args.workers.map_or_else(|| (cores / threads).max(1), usize::from);
    if args.dry_run {
        return estimate(trials, &args.runs_dir, workers);
    }
    write_plan(plan, trials)?;
    let stop = stop_flag()?;
    let mut status = Status::new(false);
    let mut tell = |at: &Launch| status.part("trials", &running(at), at.share());
    let config = LocalConfig { program, workers, threads };
    let report = launch_local(trials, plan, &args.runs_dir, &config, &mut Job::new(&mut tell, &stop))?;
    drop(status);
    for (id, why) in &report.failed {
        note(format!(
            "{id} failed: {why} ({})",
            args.runs_dir.join(id).join(etude_experiment::LOG).display()
        ));
    }
    let busy =
        if report.busy > 0 { format!(", {} are under way elsewhere", report.busy) } else { String::new() };
    line(format!("{} trials are done{busy}, {} failed", report.done, report.failed.len()))?;
    if report.stopped {
        note("stopped; the same command resumes");
        return Ok(VerbEnd::Stopped);
    }
    match report.failed.len() {
        0 => Ok(VerbEnd::Done),
        _ => Err(anyhow::anyhow!("not all trials are done; the same command runs those that failed again")),
    }
}

/// Says how much is to be done and how long it takes.
fn estimate(trials: &[Trial], runs: &Path, workers: usize) -> anyhow::Result<VerbEnd> {
    let WorkEstimate { trials, steps, fits, core_secs } = WorkEstimate::of(trials, runs)?;
    let workers = workers.min(trials.max(1));
    let each = clock(core_secs / workers as f64);
    line(format!("{trials} trials to do: {steps} steps of training and {fits} fits of the simulator"))?;
    line(format!("some {} of one core, at most {each} with {workers} at a time", clock(core_secs)))?;
    Ok(VerbEnd::Done)
}

fn running(at: &Launch) -> String {
    let one = |(id, trial): (&String, &TrialProgress)| {
        let f1 = trial.f1.map_or_else(String::new, |f1| format!(" F1 {f1:.3}"));
        // Without the fingerprint.
        let name = id.rsplit_once("__").map_or(id.as_str(), |(name, _)| name);
        format!("  {name}: {} {:.0} %{f1}", trial.phase, 100.0 * trial.share)
    };
    let failed = if at.failed.is_empty() { String::new() } else { format!(", {} failed", at.failed.len()) };
    let running: String = at.running.iter().map(one).collect();
    format!(": {} of {} done{failed}{running}", at.done, at.total)
}

fn slurm(
    args: &RunArgs,
    name: &str,
    trials: &[Trial],
    plan: &Path,
    program: PathBuf,
) -> anyhow::Result<VerbEnd> {
    if args.workers.is_some() {
        anyhow::bail!("--workers is for this machine; on the cluster --throttle bounds the trials at a time");
    }
    let indices = open_trials(trials, &args.runs_dir);
    if indices.is_empty() {
        line("all trials are done, or under way")?;
        return Ok(VerbEnd::Done);
    }
    let config = SlurmConfig {
        program,
        throttle: args.throttle.map(usize::from),
        time: args.time.clone(),
        cpus: args.threads.into(),
        options: args.sbatch.clone(),
    };
    let runs = std::path::absolute(&args.runs_dir)?;
    let plan_there = std::path::absolute(plan)?;
    let script = slurm_script(name, &plan_there, &runs, &std::env::current_dir()?, &indices, &config);
    if args.dry_run {
        line(script.trim_end())?;
        return Ok(VerbEnd::Done);
    }
    write_plan(plan, trials)?;
    let job = submit(&script, plan)?;
    line(format!(
        "job {job}: {} trials; squeue --job {job} shows them, scancel {job} ends them",
        indices.len()
    ))?;
    Ok(VerbEnd::Done)
}

fn status(args: &StatusArgs) -> anyhow::Result<VerbEnd> {
    let mut all = Vec::new();
    for (experiment, trials) in args.plan.plans()? {
        let states: Vec<TrialState> =
            trials.iter().map(|trial| TrialState::of(trial, &args.runs_dir)).collect();
        let count = |state: TrialState| states.iter().filter(|other| **other == state).count();
        if args.json {
            let rows = trials
                .iter()
                .zip(&states)
                .map(|(trial, state)| json!({ "id": trial.id, "labels": trial.labels, "state": state }));
            all.push(json!({ "experiment": experiment.name, "trials": rows.collect::<Vec<_>>() }));
            continue;
        }
        line(format!(
            "{}: {} trials, {} done, {} running, {} begun, {} waiting",
            experiment.name,
            trials.len(),
            count(TrialState::Done),
            count(TrialState::Running),
            count(TrialState::Begun),
            count(TrialState::Waiting)
        ))?;
        for (trial, state) in trials.iter().zip(&states) {
            if matches!(state, TrialState::Running | TrialState::Begun) {
                let labels: Vec<String> =
                    trial.labels.iter().map(|(key, value)| format!("{key} {value}")).collect();
                let state = if *state == TrialState::Running { "running" } else { "begun" };
                line(format!("  {state:<8} {}  {}", trial.id, labels.join(", ")))?;
            }
        }
    }
    if args.json {
        print_json(&all)?;
    }
    Ok(VerbEnd::Done)
}

fn report(args: &ReportArgs) -> anyhow::Result<VerbEnd> {
    let plans = args.plan.plans()?;
    let page = etude_experiment::write_report(&plans, &args.plan.config(), &args.runs_dir, &args.out)?;
    for missing in &page.missing {
        note(missing);
    }
    line(format!("Read {}", page.file.display()))?;
    Ok(VerbEnd::Done)
}

fn trial(args: &TrialArgs) -> anyhow::Result<VerbEnd> {
    let trials = read_plan(&args.plan)?;
    let count = trials.len();
    let trial = trials.get(args.index).ok_or_else(|| {
        anyhow::anyhow!("{} has no line {}, only {count} from 0", args.plan.display(), args.index)
    })?;
    // A cluster may send the signal more than once.
    let stop = patient_stop_flag()?;
    let mut tell = |at: &TrialProgress| {
        // The launcher reads the progress.
        if is_attended()
            && let Ok(text) = serde_json::to_string(at)
        {
            // If the launcher has ended, standard input ends too, which stops the trial.
            let _ = line(text);
        }
    };
    let command = shell_line(std::env::args());
    match run_trial(trial, &args.runs_dir, args.threads, &command, &mut Job::new(&mut tell, &stop))? {
        TrialEnd::Done => Ok(VerbEnd::Done),
        TrialEnd::Stopped => Ok(VerbEnd::Stopped),
        TrialEnd::Busy => {
            note(format!("another process is at work on {}; wait for it, or stop it", trial.id));
            Ok(VerbEnd::Busy)
        }
    }
}
