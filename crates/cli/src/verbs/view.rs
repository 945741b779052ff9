//! `etude view`: the world in a window, with the policy playing.

use super::PlayerArgs;
use crate::Ending;

/// What to play and with what.
#[derive(clap::Args)]
#[command(after_help = "\
The window is MuJoCo's: turn with the left mouse button, move with the right one, zoom with the wheel. The song begins again when \
it is over; closing the window or Ctrl-C ends. Not part of the usual build: cargo build --release --package etude --features viewer")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    song: String,
    #[command(flatten)]
    player: PlayerArgs,
}

/// Runs the verb.
#[cfg(not(feature = "viewer"))]
pub fn run(args: Args) -> anyhow::Result<Ending> {
    // What is asked for is checked all the same: a name that does not exist will not exist after a build either.
    let song = etude_lab::find_song(&args.song)?;
    args.player.load(&args.song, &song)?;
    anyhow::bail!(
        "this etude was built without the window: cargo build --release --package etude --features viewer (or `etude render` and \
         `etude replay`, which need no screen)"
    )
}

/// Runs the verb.
#[cfg(feature = "viewer")]
pub fn run(args: Args) -> anyhow::Result<Ending> {
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    use etude_stage::{Window, World};

    let song = etude_lab::find_song(&args.song)?;
    song.check_range()?;
    let player = args.player.load(&args.song, &song)?;
    let stop = crate::progress::stop_flag()?;
    let step = Duration::from_secs_f64(1.0 / etude_music::CONTROL_HZ);
    let mut shown: Option<(Window, World)> = None;
    let mut next = Instant::now();
    let mut failed = None;
    etude_lab::play_live(&song, &player, &mut |world| {
        let mut show = || -> anyhow::Result<bool> {
            if shown.is_none() {
                let own = World::new(world.config(), world.params())?;
                shown = Some((Window::open(&own)?, own));
            }
            let Some((window, own)) = &mut shown else { return Ok(false) };
            own.restore(&world.snapshot())?;
            // The window is kept alive between control steps too.
            next = (next + step).max(Instant::now());
            loop {
                window.show(own)?;
                if !window.is_open() || stop.load(Ordering::Relaxed) {
                    return Ok(false);
                }
                if Instant::now() >= next {
                    return Ok(true);
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        show().unwrap_or_else(|error| {
            failed = Some(error);
            false
        })
    })?;
    failed.map_or(Ok(Ending::Done), Err)
}
