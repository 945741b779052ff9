//! `etude twin`: an emulated robot, on sockets and by the wall clock.

use std::path::PathBuf;

use clap::ValueHint;
use etude_perform::shell_word;
use etude_robot::rig_file::RigConfig;
use etude_twin::{ArmPorts, OrderedFault, TwinParams, TwinServer};
use serde_json::json;

use crate::args;
use crate::output::{VerbEnd, line, note};
use crate::progress::stop_flag;

/// Parameters, faults and files of the twin.
#[derive(clap::Args)]
#[command(after_help = "\
The folder has twin.toml (the rig's file for --robot), its calibration, and the sockets of the hand's bus \
and of the keyboard. The arm listens on this machine only; with --arm-ports on the robot's own ports, so \
that the official SDK finds it at 127.0.0.1 (port 502 needs root). The twin runs until Ctrl-C.

Faults happen SECS after the twin was switched on, and last for the seconds after the + or without an end. A file of twin parameters \
lists them as [[faults]], with kind, at_secs and for_secs.

Examples:
  etude twin
  etude twin --fault can-bus-off@30+2 --fault arm-error=31@60
  etude perform twinkle --robot out/twin/twin.toml --home
  etude robot monitor --robot out/twin/twin.toml")]
pub struct Args {
    /// Twin parameters (the hidden physical numbers of the twin): `standard`, `worn`, `mild`,
    /// `ideal`, `random:SEED`, or a file
    #[arg(long, default_value = "standard", value_name = "NAME|random:SEED|FILE", value_parser = args::twin_params(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    twin_params: String,
    /// Inject a fault; may be repeated. An unknown KIND lists all kinds
    #[arg(long = "fault", value_name = "KIND[=VALUE]@SECS[+SECS]")]
    faults: Vec<OrderedFault>,
    /// Folder of its files and sockets
    #[arg(short = 'o', long = "out", default_value = "out/twin", value_name = "DIR")]
    out: PathBuf,
    /// Serve the arm on the robot's own ports instead of free ones
    #[arg(long)]
    arm_ports: bool,
    /// Print one JSON object when it is ready: rig
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let twin_params = TwinParams::load(&args.twin_params)?.with_faults(&args.faults)?;
    let ports = if args.arm_ports { ArmPorts::default() } else { ArmPorts::FREE };
    let mut server = TwinServer::open(&twin_params, &RigConfig::default(), &args.out, ports)?;
    let stop = stop_flag()?;
    // The twin also runs if standard output is closed.
    let _ = if args.json {
        line(json!({ "rig": server.rig() }))
    } else {
        let rig = shell_word(server.rig().display());
        line(format!("The twin `{}` is ready: --robot {rig}\nCtrl-C ends it", twin_params.name()))
    };
    server.serve(&stop)?;
    if !server.lost().is_zero() {
        let lost = server.lost().as_secs_f64();
        note(format!("warning: the machine was overloaded, and the twin's world paused for {lost:.2} s"));
    }
    Ok(VerbEnd::Stopped)
}
