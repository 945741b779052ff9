//! `etude export`: a policy for programs other than Étude.

use std::path::PathBuf;

use clap::ValueHint;
use etude_lab::find_song;
use etude_show::export::export_onnx;

use crate::args::{self, PlayerArgs, slug};
use crate::files::{check_replaceable, output_file};
use crate::output::{VerbEnd, line, print_json};
use crate::status::planner;

/// Output format.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude export onnx twinkle -o twinkle.onnx
  etude export onnx songs/mine.mid
  etude export onnx songs/mine.mid --policy runs/mine")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// The actor as an ONNX model (opset 20): `observation` [batch, o] to `action` [batch, 13],
    /// without exploration
    ///
    /// The entry `etude` of the model's metadata describes in JSON each column of the observation
    /// and of the action, with the joints' ranges for this song.
    Onnx {
        /// A built-in song or a MIDI file: the metadata has its notes due and its fingering
        #[arg(value_name = "SONG", value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
        song: String,
        /// Play a file's silence before its first note too
        #[arg(long)]
        keep_silence: bool,
        /// The file; by default SONG.onnx
        #[arg(short = 'o', long = "out", value_name = "FILE.onnx")]
        out: Option<PathBuf>,
        #[command(flatten)]
        player: PlayerArgs,
        /// Print JSON: model and policy
        #[arg(long)]
        json: bool,
    },
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let What::Onnx { song: asked, keep_silence, out, player, json: as_json } = args.what;
    let song = find_song(&asked, keep_silence)?;
    let player = player.load(&asked, &song, &mut planner(false))?;
    let out = out.unwrap_or_else(|| PathBuf::from(format!("{}.onnx", slug(&asked))));
    let out = output_file(out, "onnx", "the name must end in .onnx")?;
    check_replaceable(&out, "etude")?;
    export_onnx(&player, &song, &out)?;
    if as_json {
        print_json(&serde_json::json!({ "model": out.display().to_string(), "policy": player.name() }))?;
    } else {
        line(format!("model: {} (of {})", out.display(), player.name()))?;
    }
    Ok(VerbEnd::Done)
}
