//! Stills and videos of a recording, drawn off-screen.

use std::io::{BufWriter, Write};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{anyhow, bail};
use etude_lab::Interrupted;
use etude_music::sound::{self, write_hint};
use etude_music::{KEYS, KeySet, LOWEST_PITCH};
use etude_perform::{Job, shell_word, write_file};
use etude_stage::{FINGERS, JOINTS, Painter, SceneGeom, View, World, picture_size};
use nalgebra::{UnitQuaternion, Vector3};

use crate::replay::{Arm, Shown, Take};
use crate::strip::{self, Strip};

/// Pictures a second of a video.
pub const FRAMES_PER_SEC: u32 = 30;
/// Players and browsers want even sizes: ffmpeg's filter for that.
const EVEN: &str = "pad=ceil(iw/2)*2:ceil(ih/2)*2";

/// Where a video is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Video {
    /// A file with sound.
    File(PathBuf),
    /// Pictures in a folder with the sound beside them, since ffmpeg is not there; the command that makes a video of them.
    Frames {
        /// The folder.
        folder: PathBuf,
        /// What to run where ffmpeg is.
        command: String,
    },
}

/// Height of the fingertips' shadows, just above the white keys, m.
const FLOOR: f64 = 0.0229;
/// Radius of a fingertip's shadow when it touches, m, and height at which it is gone, m.
const SHADOW: [f64; 2] = [0.016, 0.06];
/// Shadows of one fingertip, one in another, which make its edge soft.
const SHADOWS: u32 = 4;
/// Colour of the arm's links, as on the replay page.
const ARM: [f32; 4] = [0.86, 0.87, 0.88, 1.0];

/// Draws pictures of a recording.
pub struct Studio<'a> {
    take: &'a Take,
    world: World,
    painter: Painter,
    strip: Option<Strip>,
    size: [u32; 2],
    /// What is drawn besides MuJoCo's shapes.
    ornaments: Vec<SceneGeom>,
    pixels: Vec<u8>,
}

impl<'a> Studio<'a> {
    /// Sets up pictures of `size` pixels from `view`, with the piano roll below.
    ///
    /// # Errors
    /// If there is no OpenGL, or nothing to draw.
    pub fn new(take: &'a Take, size: [u32; 2], view: View) -> anyhow::Result<Self> {
        Self::with(take, size, view, Strip::new(take, size[0], Strip::height_in(size[1])))
    }

    /// The same without the piano roll.
    ///
    /// # Errors
    /// If there is no OpenGL, or nothing to draw.
    pub fn without_roll(take: &'a Take, size: [u32; 2], view: View) -> anyhow::Result<Self> {
        Self::with(take, size, view, None)
    }

    fn with(take: &'a Take, size: [u32; 2], view: View, strip: Option<Strip>) -> anyhow::Result<Self> {
        if take.positions.is_empty() {
            bail!("{} holds no control step, so there is nothing to draw", take.name);
        }
        // One that is not possible is refused as it was asked for.
        picture_size(size[0].into(), size[1].into())?;
        let world = take.world()?;
        let below = strip.as_ref().map_or(0, |_| Strip::height_in(size[1]));
        let painter = Painter::new(&world, size[0], size[1] - below, view)?;
        let ornaments = world.ornaments();
        Ok(Self { take, world, painter, strip, size, ornaments, pixels: Vec::new() })
    }

    fn paint(&mut self, secs: f64) -> anyhow::Result<&[u8]> {
        let sounding = self.take.notes.iter().filter(|note| (note.start..note.end).contains(&secs));
        let down = KeySet::from_pitches(sounding.map(|note| note.pitch));
        self.world.pose(&joints_at(self.take, secs), down);
        self.world.colour_keys(&key_colours(self.take, secs));
        let mut shapes = self.ornaments.clone();
        shapes.extend((0..FINGERS).flat_map(|finger| shadow(self.world.fingertip(finger))));
        shapes.extend(self.take.arm.iter().flat_map(|arm| links(arm, secs * self.take.control_hz - 1.0)));
        self.pixels.clear();
        self.pixels.extend_from_slice(self.painter.paint(&mut self.world, &shapes)?);
        if let Some(strip) = &mut self.strip {
            self.pixels.extend_from_slice(strip.paint(secs));
        }
        Ok(&self.pixels)
    }

    /// Writes the picture at `secs` as PNG.
    ///
    /// # Errors
    /// If drawing or writing fails, or the recording is shorter.
    pub fn still(&mut self, secs: f64, path: &Path) -> anyhow::Result<()> {
        if !(0.0..=self.take.secs()).contains(&secs) {
            bail!("{} lasts {:.2} s: there is no picture at {secs:.2} s", self.take.name, self.take.secs());
        }
        let size = self.size;
        let pixels = self.paint(secs)?;
        write_png(path, size, pixels)
    }

    /// Writes the whole recording as a video with its sound; without ffmpeg as pictures in a folder. Reports
    /// the share that is done, 0 to 1.
    ///
    /// # Errors
    /// If drawing, encoding or writing fails; [`Interrupted`] if the job is interrupted. Then nothing is kept.
    pub fn video(&mut self, path: &Path, job: &mut Job<'_, f64>) -> anyhow::Result<Video> {
        let mut samples = self.take.sound()?;
        // Silence to the end of the picture, or ffmpeg ends with the last note.
        let whole = (self.take.secs() * f64::from(sound::SAMPLE_RATE_HZ)).ceil() as usize;
        samples.resize(samples.len().max(whole), 0.0);
        let frames = (self.take.secs() * f64::from(FRAMES_PER_SEC)).ceil().max(1.0) as u32;
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // It is removed with all that is still in it when this function ends.
        let work = tempfile::tempdir_in(parent).map_err(|error| cannot_write(parent, &error))?;
        let pictures = work.path().join("frames");
        std::fs::create_dir(&pictures).map_err(|error| cannot_write(parent, &error))?;
        let wav = pictures.join("sound.wav");
        sound::write_wav(&wav, &samples)?;
        if has_ffmpeg() {
            let video = work.path().join("video.mp4");
            self.encode(frames, &wav, &video, job)?;
            std::fs::rename(&video, path).map_err(|error| cannot_write(path, &error))?;
            return Ok(Video::File(path.to_path_buf()));
        }
        let size = self.size;
        self.pictures(frames, job, |frame, pixels| {
            write_png(&pictures.join(format!("{frame:06}.png")), size, pixels)
        })?;
        let folder = path.with_extension("frames");
        // Pictures of an earlier, longer video would be taken for the end of this one.
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::rename(&pictures, &folder).map_err(|error| cannot_write(&folder, &error))?;
        let [pictures, sound, video] = [&folder.join("%06d.png"), &folder.join("sound.wav"), path]
            .map(|path| shell_word(path.display()));
        let command = format!(
            "ffmpeg -r {FRAMES_PER_SEC} -i {pictures} -i {sound} -vf '{EVEN}' -pix_fmt yuv420p {video}"
        );
        Ok(Video::Frames { folder, command })
    }

    /// Draws every picture: its number and pixels.
    fn pictures(
        &mut self,
        frames: u32,
        job: &mut Job<'_, f64>,
        mut take: impl FnMut(u32, &[u8]) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        for frame in 0..frames {
            if job.is_interrupted() {
                return Err(Interrupted("stopped on request; nothing was kept".to_string()).into());
            }
            take(frame, self.paint(f64::from(frame) / f64::from(FRAMES_PER_SEC))?)?;
            job.tell(&(f64::from(frame + 1) / f64::from(frames)));
        }
        Ok(())
    }

    fn encode(&mut self, frames: u32, wav: &Path, out: &Path, job: &mut Job<'_, f64>) -> anyhow::Result<()> {
        let failed = |error: std::io::Error| anyhow!("ffmpeg has failed: {error}");
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
        let mut pipe = encoder.stdin.take().map(BufWriter::new);
        let mut is_broken = false;
        let drawn = self.pictures(frames, job, |_, pixels| {
            is_broken = pipe.as_mut().is_some_and(|pipe| pipe.write_all(pixels).is_err());
            anyhow::ensure!(!is_broken, "ffmpeg has ended");
            Ok(())
        });
        drop(pipe);
        let ended = encoder.wait_with_output().map_err(failed)?;
        // An encoder that has ended early says why.
        if !is_broken {
            drawn?;
        }
        if ended.status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&ended.stderr);
        bail!("ffmpeg has failed: {}", said.trim().lines().last().unwrap_or("it did not say why"))
    }
}

fn cannot_write(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("cannot write {}: {error}; {}", path.display(), write_hint(error))
}

/// Whether there is an ffmpeg to call.
pub fn has_ffmpeg() -> bool {
    let quiet = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    quiet.is_ok_and(|status| status.success())
}

/// Joint positions at `secs`, between the control steps on a straight line.
fn joints_at(take: &Take, secs: f64) -> [f64; JOINTS] {
    let last = take.positions.len() - 1;
    // Row `i` is the end of step `i`; before the first there is the start, if it is known.
    let place = (secs * take.control_hz - 1.0).clamp(-1.0, last as f64);
    let row = |place: f64| match &take.start {
        Some(start) if place < 0.0 => start,
        _ => &take.positions[place.max(0.0) as usize],
    };
    let (from, to) = (row(place.floor()), row(place.ceil()));
    let share = place - place.floor();
    std::array::from_fn(|joint| from[joint] + share * (to[joint] - from[joint]))
}

/// The colours of keys that are due or sound, as on the replay page.
fn key_colours(take: &Take, secs: f64) -> [Option<[f32; 3]>; KEYS] {
    let mut colours = [None; KEYS];
    let mut light = |pitch: u8, colour: [u8; 3]| {
        let key = pitch.checked_sub(LOWEST_PITCH).and_then(|key| colours.get_mut(usize::from(key)));
        if let Some(key) = key {
            *key = Some(colour.map(|value| f32::from(value) / 255.0));
        }
    };
    for note in take.due_notes.iter().filter(|note| (note.start..note.end).contains(&secs)) {
        light(note.pitch, strip::DUE);
    }
    let mut now = take.stretches();
    now.retain(|stretch| (stretch.note.start..stretch.note.end).contains(&secs));
    // What began last is shown: a key that is held from the note before does not play the next one.
    now.sort_by(|one, other| one.note.start.total_cmp(&other.note.start));
    for stretch in now.iter().filter(|stretch| stretch.shown != Shown::Played) {
        light(stretch.note.pitch, strip::colour(stretch.shown));
    }
    colours
}

/// The soft shadow of a fingertip at `tip` on the white keys: smaller and fainter, the higher it is.
fn shadow([x, y, z]: [f64; 3]) -> impl Iterator<Item = SceneGeom> {
    let [radius, gone] = SHADOW;
    let near = 1.0 - ((z - FLOOR) / gone).clamp(0.0, 1.0);
    let layers = if near > 0.0 { SHADOWS } else { 0 };
    (1..=layers).map(move |layer| {
        let radius = radius * f64::from(layer) / f64::from(SHADOWS) * (1.6 - 0.6 * near);
        SceneGeom {
            name: String::new(),
            body: -1,
            kind: "ellipsoid".to_string(),
            size: [radius, radius, 0.0002],
            pos: [x, y, FLOOR + 0.00005 * f64::from(layer)],
            quat: [1.0, 0.0, 0.0, 0.0],
            rgba: [0.0, 0.0, 0.0, 0.12 * near as f32],
        }
    })
}

/// The links of the arm at the end of control step `step`, between two on straight lines, as tubes.
fn links(arm: &Arm, step: f64) -> Vec<SceneGeom> {
    let last = arm.points.len().saturating_sub(1) as f64;
    let step = step.clamp(0.0, last);
    let row = |step: f64| arm.points.get(step as usize).map_or(&[][..], Vec::as_slice);
    let (from, to) = (row(step.floor()), row(step.ceil()));
    let share = step - step.floor();
    let row: Vec<f64> = from.iter().zip(to).map(|(from, to)| from + share * (to - from)).collect();
    let points: Vec<Vector3<f64>> = row.chunks_exact(3).map(Vector3::from_column_slice).collect();
    let tube = |(ends, radius): (&[Vector3<f64>], &f64)| {
        let way = ends[1] - ends[0];
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &way)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        SceneGeom {
            name: String::new(),
            body: -1,
            kind: "capsule".to_string(),
            size: [*radius, way.norm() / 2.0, 0.0],
            pos: ((ends[0] + ends[1]) / 2.0).into(),
            quat: [turn.w, turn.i, turn.j, turn.k],
            rgba: ARM,
        }
    };
    points.windows(2).zip(&arm.radii).map(tube).collect()
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
    use etude_perform::{Activity, DueNote, Header, KeyMessage, Recording, StepMessage};

    use super::*;
    use crate::replay::PlayedNote;

    /// Rest in simulation, with the keys that are due, pressed and struck.
    fn take(steps: Vec<StepMessage>, due: Vec<Vec<u8>>, keys: Vec<KeyMessage>) -> Take {
        let due_notes = if due.is_empty() {
            Vec::new()
        } else {
            vec![DueNote { pitch: 60, velocity: 80, start_secs: 0.5, end_secs: 1.0 }]
        };
        let header =
            Header { control_hz: 20.0, activity: Activity::Rest, due, due_notes, ..Header::default() };
        let recording = Recording { header, steps, keys, complete: true, ..Recording::default() };
        Take::new(&recording, "r".to_string()).unwrap()
    }

    #[test]
    fn joints_move_on_straight_lines_between_the_ends_of_steps() {
        // The start pose is known of a simulation only.
        let step = |value: f64| StepMessage { positions: vec![value; JOINTS], ..StepMessage::default() };
        let take = take(vec![step(0.1), step(0.3)], Vec::new(), Vec::new());
        for (secs, value) in [(0.0, 0.1), (0.05, 0.1), (0.075, 0.2), (0.1, 0.3), (9.0, 0.3)] {
            assert!((joints_at(&take, secs)[0] - value).abs() < 1e-9, "{secs}");
        }
    }

    /// A note that is due in the second half of a second, and a stroke of `pitch` at `start`.
    fn second(pitch: u8, start: f64) -> Take {
        let step = |index: usize| StepMessage {
            positions: vec![0.0; JOINTS],
            pressed: if index < 10 { Vec::new() } else { vec![pitch] },
            ..StepMessage::default()
        };
        let due = (0..20).map(|index| if index < 10 { Vec::new() } else { vec![60] }).collect();
        let key = |secs, velocity| KeyMessage { secs, pitch, velocity };
        take((0..20).map(step).collect(), due, vec![key(start, 80), key(1.0, 0)])
    }

    #[test]
    fn keys_are_lit_as_they_are_played() {
        let colour = |take: &Take, secs: f64, pitch: u8| {
            key_colours(take, secs)[usize::from(pitch - LOWEST_PITCH)]
                .map(|colour| colour.map(|value| (255.0 * value).round() as u8))
        };
        // A few milliseconds late are right, and until then the key is due.
        let right = second(60, 0.53);
        assert_eq!(colour(&right, 0.2, 60), None);
        assert_eq!(colour(&right, 0.52, 60), Some(strip::DUE));
        assert_eq!(colour(&right, 0.6, 60), Some(strip::RIGHT));
        assert_eq!(colour(&second(60, 0.6), 0.7, 60), Some(strip::OFF));
        let wrong = second(62, 0.5);
        assert_eq!(colour(&wrong, 0.6, 60), Some(strip::MISSED));
        assert_eq!(colour(&wrong, 0.6, 62), Some(strip::WRONG));
        // Down since long before, it plays nothing.
        let mut held = take(Vec::new(), vec![vec![60]], Vec::new());
        held.notes = vec![PlayedNote { start: 0.0, ..held.due_notes[0] }];
        assert_eq!(colour(&held, 0.4, 60), Some(strip::WRONG));
        assert_eq!(colour(&held, 0.6, 60), Some(strip::MISSED));
    }

    #[test]
    fn the_links_of_an_arm_are_tubes_between_its_points() {
        let row = |x: f64| vec![x, 0.0, 0.0, x, 0.0, 0.4, x, 0.3, 0.4];
        let arm = Arm { radii: vec![0.05, 0.04], points: vec![row(0.0), row(0.2)] };
        assert!(links(&Arm { points: Vec::new(), ..arm.clone() }, 0.0).is_empty());
        let tubes = links(&arm, 0.5);
        assert_eq!(tubes.len(), 2);
        for (tube, (pos, half, axis)) in
            tubes.iter().zip([([0.1, 0.0, 0.2], 0.2, Vector3::z()), ([0.1, 0.15, 0.4], 0.15, Vector3::y())])
        {
            assert!((Vector3::from(tube.pos) - Vector3::from(pos)).norm() < 1e-12, "{tube:?}");
            assert!((tube.size[1] - half).abs() < 1e-12, "{tube:?}");
            let [w, i, j, k] = tube.quat;
            let turned =
                UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k)) * Vector3::z();
            assert!((turned - axis).norm() < 1e-9, "{tube:?}");
        }
        assert_eq!(links(&arm, 7.0)[0].pos[0], 0.2);
    }

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
            let mut studio = match Studio::new(&take, [320, 180], view) {
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
