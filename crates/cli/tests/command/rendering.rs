//! `etude render`: stills and videos.

use std::collections::BTreeSet;
use std::process::Command;

use serde_json::Value;

use crate::browser::skip;
use crate::replaying::played;
use crate::{Sandbox, errors};

/// Whether pictures can be drawn here at all.
pub fn draws(sandbox: &Sandbox) -> bool {
    let output = sandbox.command("render out --at 0 --size 64x48 -o probe.png").output().unwrap();
    if !output.status.success() {
        assert!(errors(&output).contains("no off-screen OpenGL here"), "{}", errors(&output));
        skip("there is no off-screen OpenGL here");
    }
    output.status.success()
}

#[test]
fn a_still_has_its_size_and_every_view_is_another() {
    let sandbox = played();
    if !draws(&sandbox) {
        return;
    }
    let mut seen = BTreeSet::new();
    for view in ["player", "side", "top", "fingers"] {
        sandbox.ok(&format!("render out --at 0.5 --view {view} --size 320x180 -o {view}.png"));
        let png = sandbox.bytes(format!("{view}.png"));
        assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
        assert_eq!((number(16), number(20)), (320, 180));
        seen.insert(png);
    }
    assert_eq!(seen.len(), 4);
    for (args, part) in [
        ("render out --at 99 -o x.png", "there is no picture at 99.00 s"),
        ("render out --at 0 --size 9999x1 -o x.png", "at most 1920 × 1080"),
    ] {
        let output = sandbox.command(args).output().unwrap();
        assert!(output.status.code() == Some(1) && errors(&output).contains(part), "{}", errors(&output));
    }
}

/// Where the system has no OpenGL, the message says what to install, and nothing is left behind.
#[test]
fn a_machine_without_opengl_is_told_what_to_install() {
    let sandbox = played();
    let mut command = sandbox.command("render out -o video.mp4");
    let output = command.env("__EGL_VENDOR_LIBRARY_DIRS", sandbox.path("nowhere")).output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains("libegl1 libgl1-mesa-dri"), "{said}");
    assert!(!sandbox.path("video.mp4").exists());
}

#[test]
fn a_video_has_picture_and_sound() {
    let sandbox = played();
    if !draws(&sandbox) {
        return;
    }
    let mut without = sandbox.command("render out --size 64x48 -o without.mp4");
    let output = without.env("PATH", sandbox.path("nowhere")).output().unwrap();
    assert!(output.status.code() == Some(1) && errors(&output).contains("apt-get install -y ffmpeg"));
    assert!(!sandbox.path("without.mp4").exists());

    if Command::new("ffprobe").arg("-version").output().is_err() {
        return skip("there is no ffmpeg here");
    }
    let said = errors(&sandbox.command("render out --size 321x180 -o video.mp4").output().unwrap());
    assert!(said.starts_with("drawing, "), "{said}");
    let probe = Command::new("ffprobe")
        .args([
            "-v",
            "error",
            "-show_entries",
            "stream=codec_type,width,height:format=duration",
            "-of",
            "json",
        ])
        .arg(sandbox.path("video.mp4"))
        .output()
        .unwrap();
    let probe: Value = serde_json::from_slice(&probe.stdout).unwrap();
    let kinds: BTreeSet<&str> =
        probe["streams"].as_array().unwrap().iter().map(|s| s["codec_type"].as_str().unwrap()).collect();
    assert_eq!(kinds, BTreeSet::from(["audio", "video"]));
    let secs: f64 = probe["format"]["duration"].as_str().unwrap().parse().unwrap();
    let report: Value = serde_json::from_slice(&sandbox.bytes("out/1/report.json")).unwrap();
    let played = report["steps"].as_f64().unwrap() / 20.0;
    assert!((secs - played).abs() < 0.2, "{secs} s of {played}");
}
