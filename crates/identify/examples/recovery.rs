//! Recovers known parameters: `cargo run --release -p etude-identify --example recovery -- SEED…`.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

#[path = "../tests/identify/synthetic.rs"]
mod synthetic;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let joints: Vec<usize> = (0..etude_stage::DRIVEN_JOINTS).collect();
    for seed in std::env::args().skip(1) {
        let recovery = synthetic::recover(&joints, seed.parse()?)?;
        println!("seed {seed}");
        for end in &recovery.passes {
            let [before, after] = end.rms;
            let (name, replays, secs) = (end.pass.name(), end.replays, end.secs);
            println!("{name}: {before:.2} to {after:.2} after {replays} replays, {secs:.0} s");
        }
        println!("joint, held-out error over noise before the fit and after it");
        for (joint, [before, after]) in &recovery.held_out {
            println!("{joint} {before:.1} {after:.2}");
        }
        println!("number, found, 95 % interval, true");
        for (found, truth) in &recovery.numbers {
            let [low, high] = found.interval;
            println!("{} {:.6} {low:.6} {high:.6} {truth:.6}", found.path, found.value);
        }
        println!(
            "{} identifiable numbers, median error {:.4}, covered by their intervals {:.3}",
            recovery.numbers.len(),
            recovery.median_error(),
            recovery.coverage()
        );
    }
    Ok(())
}
