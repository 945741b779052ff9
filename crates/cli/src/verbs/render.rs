//! `etude render`: stills and videos of a recording.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use etude_perform::Job;
use etude_show::render::Studio;
use etude_show::replay::{read_take, recording};
use etude_stage::View;

use crate::files::output_file;
use crate::output::{VerbEnd, line, note_incomplete, print_json};
use crate::progress::stop_flag;
use crate::status::Status;

/// Recording, camera and output.
#[derive(clap::Args)]
#[command(after_help = "\
The keys have the colours of the replay page: light blue due, blue right, orange wrong, red missed. Below \
is the piano roll. No screen is needed: a GPU draws if there is one, otherwise Mesa on the processor. \
Videos need ffmpeg, which encodes them with the sound.

Examples:
  etude render out/twinkle -o twinkle.mp4
  etude render out/twinkle --at 4.5 --view player -o still.png")]
pub struct Args {
    /// A recording (*.mcap), or a folder that holds one; of numbered results the latest
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// The file: .mp4 for a video, .png for a still; by default beside the recording, with its name
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw a still at this time, s
    #[arg(long, value_name = "SECS")]
    at: Option<f64>,
    /// The camera
    #[arg(long, default_value = "fingers", value_parser = view())]
    view: View,
    /// Width and height, pixels
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = size)]
    size: [u32; 2],
    /// Print JSON: picture or video
    #[arg(long)]
    json: bool,
}

/// The names of the views.
fn view() -> impl TypedValueParser<Value = View> {
    PossibleValuesParser::new(View::ALL.map(View::name)).map(|name| View::of(&name).unwrap_or_default())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let (width, height) =
        text.split_once('x').ok_or("two numbers with an x between them, for example 1280x720")?;
    let number = |text: &str| text.parse::<u32>().map_err(|_| format!("`{text}` is not a number of pixels"));
    Ok([number(width)?, number(height)?])
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let recording = recording(&args.recording)?;
    let is_still = args.at.is_some();
    let wanted = if is_still { "png" } else { "mp4" };
    let out = args.out.unwrap_or_else(|| recording.with_extension(wanted));
    let hint = if is_still {
        "the name must end in .png"
    } else {
        "the name must end in .mp4; --at SECS makes a still"
    };
    let out = output_file(out, wanted, hint)?;
    let take = read_take(&recording)?;
    note_incomplete(std::slice::from_ref(&take));
    let mut studio = Studio::new(&take, args.size, args.view, is_still)?;
    let what = if let Some(secs) = args.at {
        studio.still(secs, &out)?;
        "picture"
    } else {
        let stop = stop_flag()?;
        let mut status = Status::new(args.json);
        let mut tell = |done: &f64| status.share("drawing", *done);
        studio.video(&out, &mut Job::new(&mut tell, &stop))?;
        "video"
    };
    if args.json {
        print_json(&serde_json::json!({ what: out.display().to_string() }))?;
    } else {
        line(format!("{what}: {}", out.display()))?;
    }
    Ok(VerbEnd::Done)
}
