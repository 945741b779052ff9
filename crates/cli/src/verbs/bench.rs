//! `etude bench`: the speed of the simulation, of the learner and of both together.

use etude_lab::bench::{BenchReport, measure};

use crate::args;
use crate::output::{Ending, line, print_json};

/// Duration and output of the measurement.
#[derive(clap::Args)]
#[command(after_help = "\
Prints a table that is Markdown too. `benches/run.py` in the repository, or `make bench`, measures JAX, PyTorch, \
mujoco.rollout, RoboPianist and SBX in turns with it and prints the ratios.

Example:
  etude bench --secs 10")]
pub struct Args {
    /// Seconds for each measurement
    #[arg(long, default_value_t = 5.0, value_name = "SECS", value_parser = args::positive, allow_hyphen_values = true)]
    secs: f64,
    /// Print JSON: env_steps_per_sec, updates_per_sec, train_steps_per_sec, start_up_secs,
    /// peak_memory_mib, rows, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let report = measure(&std::env::current_exe()?, args.secs)?;
    if args.json {
        print_json(&report.json())?
    } else {
        print_table(&report)?
    }
    Ok(Ending::Done)
}

fn print_table(report: &BenchReport) -> anyhow::Result<()> {
    line(format!("Machine: {}\n", report.machine))?;
    line(format!("| {:42} | {:>20} |\n| {:-<42} | {:-<20} |", "what", "Étude", "", ""))?;
    for row in &report.rows {
        let figure =
            row.value.map_or("unknown".to_string(), |value| format!("{} {}", short(value), row.unit));
        line(format!("| {:42} | {figure:>20} |", row.what))?;
    }
    line(format!(
        "\nThe environment takes {:.1} % more time than its mj_step calls.",
        report.overhead * 100.0
    ))
}

/// A number with at least three digits.
fn short(value: f64) -> String {
    let digits = usize::from(value < 100.0) + usize::from(value < 10.0);
    format!("{value:.digits$}")
}
