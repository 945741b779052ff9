//! Stills and videos of a recording, drawn off-screen.

mod moment;

use std::io::{BufWriter, ErrorKind, Write};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, anyhow, bail};
use etude_lab::Interrupted;
use etude_music::KeySet;
use etude_music::sound::{self, write_hint};
use etude_perform::{Job, write_file};
use etude_stage::{FINGERS, Painter, SceneGeom, View, World, picture_size};

use self::moment::{joints_at, key_colours, links, shadow};
use crate::replay::Take;
use crate::strip::Strip;

/// Pictures a second of a video.
const FRAMES_PER_SEC: u32 = 30;
/// Players and browsers want even sizes: ffmpeg's filter for that.
const EVEN: &str = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
/// What to do if ffmpeg has failed.
const FFMPEG_HINT: &str = "check `ffmpeg -version` and the free disk space";

/// Draws pictures of a recording.
pub struct Studio<'a> {
    take: &'a Take,
    world: World,
    painter: Painter,
    strip: Option<Strip>,
    size: [u32; 2],
    /// What is drawn besides MuJoCo's shapes.
    ornaments: Vec<SceneGeom>,
}

impl<'a> Studio<'a> {
    /// Sets up pictures of `size` pixels from `view`, with the piano roll below. Smooth edges take
    /// twice as long where the processor draws.
    ///
    /// # Errors
    /// If there is no OpenGL, or nothing to draw.
    pub fn new(take: &'a Take, size: [u32; 2], view: View, smooth: bool) -> anyhow::Result<Self> {
        Self::with(take, size, view, smooth, Strip::new(take, size[0], Strip::height_in(size[1])))
    }

    /// The same without the piano roll, with smooth edges.
    ///
    /// # Errors
    /// If there is no OpenGL, or nothing to draw.
    pub fn without_roll(take: &'a Take, size: [u32; 2], view: View) -> anyhow::Result<Self> {
        Self::with(take, size, view, true, None)
    }

    fn with(
        take: &'a Take,
        size: [u32; 2],
        view: View,
        smooth: bool,
        strip: Option<Strip>,
    ) -> anyhow::Result<Self> {
        if take.positions.is_empty() {
            bail!("{} holds no control step, so there is nothing to draw", take.name);
        }
        // One that is not possible is refused as it was asked for.
        picture_size(size[0].into(), size[1].into())?;
        let mut world = take.world()?;
        let below = strip.as_ref().map_or(0, |_| Strip::height_in(size[1]));
        let painter = Painter::new(&mut world, [size[0], size[1] - below], view, smooth)?;
        let ornaments = world.visual_geoms();
        Ok(Self { take, world, painter, strip, size, ornaments })
    }

    fn paint(&mut self, secs: f64) -> anyhow::Result<Vec<u8>> {
        let sounding = self.take.notes.iter().filter(|note| (note.start..note.end).contains(&secs));
        let down = KeySet::from_pitches(sounding.map(|note| note.pitch));
        self.world.pose(&joints_at(self.take, secs), down);
        self.world.colour_keys(&key_colours(self.take, secs));
        let mut shapes = self.ornaments.clone();
        shapes.extend((0..FINGERS).flat_map(|finger| shadow(self.world.fingertip(finger))));
        shapes.extend(self.take.arm.iter().flat_map(|arm| links(arm, self.take.step_at(secs))));
        let mut pixels = self.painter.paint(&mut self.world, &shapes)?.to_vec();
        if let Some(strip) = &self.strip {
            pixels.extend(strip.paint(secs));
        }
        Ok(pixels)
    }

    /// Writes the picture at `secs` as PNG.
    ///
    /// # Errors
    /// If drawing or writing fails, or the recording is shorter.
    pub fn still(&mut self, secs: f64, path: &Path) -> anyhow::Result<()> {
        if !(0.0..=self.take.secs()).contains(&secs) {
            bail!(
                "{} lasts {:.2} s: there is no picture at {secs:.2} s; choose a time within the recording",
                self.take.name,
                self.take.secs()
            );
        }
        let pixels = self.paint(secs)?;
        write_png(path, self.size, &pixels)
    }

    /// Writes the whole recording as a video with its sound. Reports the share that is done, 0 to
    /// 1.
    ///
    /// # Errors
    /// If there is no ffmpeg, or drawing, encoding or writing fails; [`Interrupted`] if the job is
    /// interrupted. Then nothing is kept.
    pub fn video(&mut self, path: &Path, job: &mut Job<'_, f64>) -> anyhow::Result<()> {
        let mut samples = self.take.sound()?;
        // Silence to the end of the picture, or ffmpeg ends with the last note.
        let whole = (self.take.secs() * f64::from(sound::SAMPLE_RATE_HZ)).ceil() as usize;
        samples.resize(samples.len().max(whole), 0.0);
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // It is removed with all that is still in it when this function ends.
        let work = tempfile::tempdir_in(parent).map_err(|error| cannot_write(parent, &error))?;
        let [wav, video] = ["sound.wav", "video.mp4"].map(|name| work.path().join(name));
        sound::write_wav(&wav, &samples)?;
        self.encode(&wav, &video, job)?;
        std::fs::rename(&video, path).map_err(|error| cannot_write(path, &error))
    }

    /// Draws every picture into `pipe`, until it is closed at its other end.
    fn pictures(&mut self, pipe: &mut impl Write, job: &mut Job<'_, f64>) -> anyhow::Result<()> {
        let frames = (self.take.secs() * f64::from(FRAMES_PER_SEC)).ceil().max(1.0) as u32;
        for frame in 0..frames {
            if job.is_interrupted() {
                return Err(Interrupted("stopped on request; nothing was kept".to_string()).into());
            }
            if pipe.write_all(&self.paint(f64::from(frame) / f64::from(FRAMES_PER_SEC))?).is_err() {
                break;
            }
            job.report(&(f64::from(frame + 1) / f64::from(frames)));
        }
        Ok(())
    }

    fn encode(&mut self, wav: &Path, out: &Path, job: &mut Job<'_, f64>) -> anyhow::Result<()> {
        let failed = |error: std::io::Error| match error.kind() {
            ErrorKind::NotFound => anyhow!(
                "there is no ffmpeg here to write a video (Debian, Ubuntu: apt-get install -y ffmpeg); --at SECS makes a still"
            ),
            _ => anyhow!("ffmpeg has failed: {error}; {FFMPEG_HINT}"),
        };
        let [width, height] = self.size;
        let mut encoder = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &FRAMES_PER_SEC.to_string(), "-i", "-", "-i"])
            .arg(wav)
            .args([
                "-vf",
                EVEN,
                "-c:v",
                "libx264",
                "-preset",
                "superfast",
                "-crf",
                "20",
                "-pix_fmt",
                "yuv420p",
            ])
            .args(["-c:a", "aac", "-shortest", "-movflags", "+faststart"])
            .arg(out)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // A Ctrl-C in the terminal must not reach ffmpeg; it ends when the pictures end.
            .process_group(0)
            .spawn()
            .map_err(failed)?;
        let mut pipe = BufWriter::new(encoder.stdin.take().context("ffmpeg has no input")?);
        let drawn = self.pictures(&mut pipe, job);
        drop(pipe);
        let ended = encoder.wait_with_output().map_err(failed)?;
        drawn?;
        if ended.status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&ended.stderr);
        bail!(
            "ffmpeg has failed: {}; {FFMPEG_HINT}",
            said.trim().lines().last().unwrap_or("it did not say why")
        )
    }
}

fn cannot_write(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("cannot write {}: {error}; {}", path.display(), write_hint(error))
}

/// Writes rows of red, green, blue as a PNG file.
fn write_png(path: &Path, [width, height]: [u32; 2], pixels: &[u8]) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(write_file(path, &bytes)?)
}

#[cfg(test)]
mod tests {
    use super::moment::tests::second;
    use super::*;

    /// The share of a picture's upper part that is blue, as a key that is right.
    fn blue(studio: &mut Studio<'_>, secs: f64) -> f64 {
        let [width, height] = studio.size;
        let scene = 3 * (width * (height - Strip::height_in(height))) as usize;
        let pixels = studio.paint(secs).unwrap();
        assert_eq!(pixels.len(), 3 * (width * height) as usize);
        let is_blue = |rgb: &&[u8]| rgb[2] > 60 && u32::from(rgb[2]) > 3 * u32::from(rgb[0]).max(1);
        let count = pixels[..scene].chunks_exact(3).filter(is_blue).count();
        count as f64 / (scene / 3) as f64
    }

    #[test]
    fn a_key_that_is_played_is_seen() {
        let take = second(60, 0.5);
        // From above the palm hides it, from the side the keys before it.
        for view in [View::Player, View::Fingers] {
            let mut studio = match Studio::new(&take, [320, 180], view, false) {
                Ok(studio) => studio,
                Err(error) => {
                    assert!(std::env::var_os("ETUDE_NEEDS_ALL").is_none(), "{error}");
                    return;
                }
            };
            let (before, during) = (blue(&mut studio, 0.2), blue(&mut studio, 0.7));
            assert!(before == 0.0 && during > 0.0003, "{}: {before} before, {during} during", view.name());
        }
    }
}
