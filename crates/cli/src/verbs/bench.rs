//! `etude bench`: the speed of the simulation, of the learner and of both together, against the bare engine and peers.

use std::path::{Path, PathBuf};

use etude_lab::bench::{BenchReport, measure};

use super::{line, note};
use crate::Ending;

/// What to measure and for how long.
#[derive(clap::Args)]
#[command(after_help = "\
Prints a table that is Markdown too. A ratio above 1 says how many times faster, or smaller, Étude is. Rates on a shared \
machine swing: compare ratios of one run, in which each measurement takes turns with its peers.

With --peers, each script in benches/peers makes itself a throw-away virtual environment in /tmp, which needs the network \
and some minutes once, and for all of them 15 GB of disk. A peer that does not run becomes a line with the reason.

Examples:
  etude bench
  etude bench --peers > table.md")]
pub struct Args {
    /// Seconds for each measurement
    #[arg(long, default_value_t = 5.0, value_name = "SECS", value_parser = super::positive, allow_hyphen_values = true)]
    secs: f64,
    /// Also run the peers, with the scripts in this folder
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "benches/peers")]
    peers: Option<PathBuf>,
    /// Print JSON: env_steps_per_sec, updates_per_sec, train_steps_per_sec, start_up_secs, peak_memory_mib, peers, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let program = std::env::current_exe()?;
    let mut tell = |script: &Path| note(format!("running {} …", script.display()));
    let report = measure(&program, args.secs, args.peers.as_deref(), &mut tell)?;
    if args.json {
        super::json(&report.json())?;
    } else {
        print_table(&report, args.peers.is_some())?;
    }
    Ok(Ending::Done)
}

fn print_table(report: &BenchReport, with_peers: bool) -> anyhow::Result<()> {
    line(format!("Machine: {}\n", report.machine))?;
    let mut table = vec![["what", "Étude", "peer", "peer's", "ratio"].map(String::from)];
    for row in &report.rows {
        let ours = row.ours.map_or("unknown".to_string(), |ours| format!("{} {}", short(ours), row.unit));
        let mut cells = [row.what.clone(), ours, String::new(), String::new(), String::new()];
        for (peer, theirs) in &row.theirs {
            cells[2..].clone_from_slice(&[
                peer.clone(),
                short(*theirs),
                row.ratio(*theirs).map_or("unknown".to_string(), |ratio| format!("{ratio:.2}")),
            ]);
            table.push(std::mem::take(&mut cells));
        }
        if row.theirs.is_empty() {
            table.push(cells);
        }
    }
    let widths: [usize; 5] = std::array::from_fn(|column| {
        table.iter().map(|cells| cells[column].chars().count()).max().unwrap_or_default()
    });
    for (index, cells) in table.iter().enumerate() {
        let [what, ours, peer, theirs, ratio] = cells;
        let [a, b, c, d, e] = widths;
        line(format!("| {what:a$} | {ours:>b$} | {peer:c$} | {theirs:>d$} | {ratio:>e$} |"))?;
        if index == 0 {
            let [a, b, c, d, e] = widths.map(|width| "-".repeat(width));
            line(format!("| {a} | {b} | {c} | {d} | {e} |"))?;
        }
    }
    line(format!(
        "\nThe environment takes {:.1} % more time than its mj_step calls.",
        report.overhead * 100.0
    ))?;
    if with_peers {
        line(
            "Peers are kept to the first N processors, since not all of them count threads; Étude has N threads.",
        )?;
    }
    for (script, reason) in &report.failed {
        line(format!("{script} did not run: {}", reason.as_str().unwrap_or_default()))?;
    }
    if !with_peers {
        line("(add --peers to run JAX, PyTorch, mujoco.rollout, RoboPianist and SBX in turns with it)")?;
    }
    Ok(())
}
/// A number with three figures or a few more.
fn short(value: f64) -> String {
    let digits = if value >= 100.0 {
        0
    } else if value >= 10.0 {
        1
    } else {
        2
    };
    format!("{value:.digits$}")
}
