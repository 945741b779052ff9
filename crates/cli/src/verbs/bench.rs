//! `etude bench`: the speed of the simulation against the bare engine, and of the learner against JAX.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context as _;
use etude_learn::DroqConfig;
use serde_json::json;

use super::{ConfigArgs, line};
use crate::Ending;

/// What to measure and for how long.
#[derive(clap::Args)]
#[command(after_help = "\
Rates on a shared machine swing; compare ratios of one run. With --jax, the same update runs in JAX in the same run, in
turns with ours: benches/peers/jax_update.sh makes a throw-away virtual environment for it and needs the network once.")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Seconds for each measurement
    #[arg(long, default_value_t = 5.0, value_name = "SECS", value_parser = super::positive, allow_hyphen_values = true)]
    secs: f64,
    /// Also run the same update in JAX, with the script in this folder
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "benches/peers")]
    jax: Option<PathBuf>,
    /// Print JSON: env_steps_per_sec, env_steps_per_sec_all_cores, env_overhead, updates_per_sec, jax_updates_per_sec, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let config = args.config.resolve(&[])?;
    let song = etude_music::repertoire::get("c-major-scale").context("the C-major scale is built in")?;
    let stepping = etude_task::bench::stepping(&config.task, &song, args.secs)?;
    let droq = DroqConfig::default();
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..3 {
        ours.push(etude_learn::bench::update_rate(&droq, args.secs / 3.0, false)?);
        if let Some(folder) = &args.jax {
            theirs.push(jax(folder, args.secs / 3.0)?);
        }
    }
    let (ours, theirs) = (median(ours), (!theirs.is_empty()).then(|| median(theirs)));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if args.json {
        super::json(&json!({
            "cores": cores,
            "env_steps_per_sec": stepping.steps_per_sec,
            "bare_steps_per_sec": stepping.bare_steps_per_sec,
            "env_overhead": stepping.overhead(),
            "env_steps_per_sec_all_cores": stepping.steps_per_sec_all_cores,
            "updates_per_sec": ours,
            "jax_updates_per_sec": theirs,
            "jax_ratio": theirs.map(|theirs| ours / theirs),
        }))?;
        return Ok(Ending::Done);
    }
    line(format!("environment, one core       {:>8.0} control steps/s", stepping.steps_per_sec))?;
    line(format!("the bare mj_step calls      {:>8.0} control steps/s", stepping.bare_steps_per_sec))?;
    line(format!("cost beyond the engine      {:>8.1} %", stepping.overhead() * 100.0))?;
    line(format!(
        "environments, {cores:2} cores      {:>8.0} control steps/s",
        stepping.steps_per_sec_all_cores
    ))?;
    line(format!("one full DroQ update, 1 core {:>7.0} updates/s", ours))?;
    match theirs {
        Some(theirs) => {
            line(format!("the same in JAX, 1 core     {theirs:>8.0} updates/s"))?;
            line(format!("ratio                       {:>8.2} x", ours / theirs))?;
        }
        None => line("(add --jax to run the same update in JAX beside it)")?,
    }
    Ok(Ending::Done)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn jax(folder: &Path, secs: f64) -> anyhow::Result<f64> {
    let script = folder.join("jax_update.sh");
    let output = Command::new("sh")
        .arg(&script)
        .args([&format!("{secs}"), "1"])
        .output()
        .with_context(|| format!("cannot run {}", script.display()))?;
    anyhow::ensure!(
        output.status.success(),
        "{} failed:\n{}",
        script.display(),
        String::from_utf8_lossy(&output.stderr).trim()
    );
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().rev().find(|line| line.starts_with('{')).context("it printed no JSON")?;
    let value: serde_json::Value = serde_json::from_str(last)?;
    value["updates_per_sec"].as_f64().context("its JSON has no updates_per_sec")
}
