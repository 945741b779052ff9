//! Prints our update rate as JSON, in the form of `benches/peers/*_update.py`.
//!
//! ```text
//! cargo run --release -p etude-learn --example update_bench -- [seconds] [threads] [bf16]
//! ```
#![allow(clippy::print_stdout)] // Printing is what it is for.

use std::error::Error;

use etude_learn::{Arithmetic, DroqConfig, bench::update_rate};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().map_or(Ok(3.0), |text| text.parse())?;
    let threads: usize = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let arithmetic =
        if arguments.next().as_deref() == Some("bf16") { Arithmetic::Bf16 } else { Arithmetic::F32 };
    let rate = update_rate(&DroqConfig { arithmetic, ..DroqConfig::default() }, seconds, threads)?;
    println!("{{\"peer\": \"etude\", \"threads\": {threads}, \"updates_per_sec\": {rate:.1}}}");
    Ok(())
}
