//! The view on terminals of several sizes.

use std::fmt::Write as _;
use std::path::Path;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::style::Color;

use super::view::View;

/// A run with so many log lines of a thousand steps, and an evaluation every second one.
fn write_run(folder: &Path, song: &str, lines: u32, best: f64) {
    std::fs::create_dir_all(folder).unwrap();
    let config = "[trainer]\ntotal_steps = 20_000\nlog_every_steps = 1000\nevaluate_every_steps = 2000\n";
    std::fs::write(folder.join("config.toml"), config).unwrap();
    std::fs::write(folder.join("meta.json"), format!("{{\"song\":\"{song}\"}}")).unwrap();
    let mut text = String::new();
    for line in 1..=lines {
        let (step, secs, share) = (line * 1000, line * 10, f64::from(line) / f64::from(lines));
        writeln!(
            text,
            "{{\"step\":{step},\"charts/reward_per_step\":{share},\"reward/energy\":-0.02,\"reward/key_press\":{share},\
              \"perf/steps_per_sec\":100.0,\"perf/elapsed_secs\":{secs}.0}}"
        )
        .unwrap();
        if line % 2 == 0 {
            writeln!(
                text,
                "{{\"step\":{step},\"eval/f1\":{},\"eval/notes_right\":{},\"eval/notes_missed\":{},\"eval/notes_wrong\":{}}}",
                best * share,
                line / 2,
                10 - line / 2,
                line / 4
            )
            .unwrap();
        }
    }
    std::fs::write(folder.join("metrics.jsonl"), text).unwrap();
}

/// A view of two runs, and their folder.
fn two_runs(colours: bool) -> (tempfile::TempDir, View) {
    let folder = tempfile::tempdir().unwrap();
    write_run(&folder.path().join("twinkle__fast__0"), "Twinkle", 20, 0.96);
    write_run(&folder.path().join("ode__fast__1/training"), "Ode", 8, 0.61);
    let folders = ["twinkle__fast__0", "ode__fast__1"].map(|name| folder.path().join(name)).to_vec();
    let mut view = View::new(folders, colours).unwrap();
    view.read().unwrap();
    (folder, view)
}

fn drawn(view: &View, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| view.draw(frame)).unwrap();
    terminal.backend().buffer().clone()
}

fn lines(buffer: &Buffer) -> Vec<String> {
    let rows = buffer.content().chunks(usize::from(buffer.area.width));
    rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>().trim_end().to_string()).collect()
}

fn press(view: &mut View, code: KeyCode) -> bool {
    view.key(KeyEvent::new(code, KeyModifiers::NONE))
}

#[test]
fn two_runs_fit_an_old_terminal() {
    let (_folder, mut view) = two_runs(true);
    let buffer = drawn(&view, 80, 24);
    let text = lines(&buffer);
    assert_eq!(
        text[..3],
        [
            "   run                     step        left        notes F1 best state",
            " a twinkle__fast__0     20k/20k           -     10/10 +5   0.960 finished",
            " b ode__fast__1          8k/20k        2:00      4/10 +2   0.610 running",
        ]
    );
    assert!(text[3].starts_with(" F1 over steps ─"), "{text:#?}");
    // Whole tenths around what there is, from 0.096 to 0.96; both curves bear their letters.
    assert!(text[4].starts_with("1.00 │") && text[4].ends_with('a'), "{text:#?}");
    assert!(text.iter().any(|line| line.starts_with("0.00 │")), "{text:#?}");
    assert!(text[4..14].iter().any(|line| line.contains('b')), "{text:#?}");
    let axis = text.iter().find(|line| line.ends_with("20k") && line.contains("10k")).unwrap();
    assert_eq!(axis.trim_start().chars().next(), Some('0'));
    for (begin, end) in [
        (" a Twinkle · finished ─", "now      lowest … highest"),
        (" reward per step    ▁", "1.000    0.050 …   1.000"),
        (" energy             ", "-0.020   -0.020 …  -0.020"),
        (" key press          ▁", "1.000    0.050 …   1.000"),
        (" steps/s            ", "100      100 …     100"),
        (" q quit   ↑↓ choose a run   s steps/time   ? help", ""),
    ] {
        assert!(
            text.iter().any(|line| line.starts_with(begin) && line.ends_with(end)),
            "{begin:?} in {text:#?}"
        );
    }
    // The letter and the curve have the run's colour.
    assert_eq!(buffer[(1, 1)].fg, Color::Indexed(75));
    assert_eq!(buffer[(1, 2)].fg, Color::Indexed(208));
    assert!(buffer.content().iter().filter(|cell| cell.fg == Color::Indexed(75)).count() > 30);

    press(&mut view, KeyCode::Down);
    press(&mut view, KeyCode::Char('s'));
    let text = lines(&drawn(&view, 80, 24)).join("\n");
    assert!(text.contains(" b Ode · running ─") && text.contains(" F1 over training time ─"), "{text}");
    assert!(text.contains("3:20"), "{text}");
}

#[test]
fn no_colours_means_none() {
    let (_folder, view) = two_runs(false);
    assert!(drawn(&view, 80, 24).content().iter().all(|cell| cell.fg == Color::Reset));
}

#[test]
fn keys_choose_and_leave() {
    let (_folder, mut view) = two_runs(true);
    for (key, expected) in [(KeyCode::Tab, 1), (KeyCode::Down, 0), (KeyCode::Up, 1), (KeyCode::BackTab, 0)] {
        assert!(press(&mut view, key));
        assert_eq!(view.selected, expected);
    }
    assert!(press(&mut view, KeyCode::Char('?')));
    let text = lines(&drawn(&view, 80, 24)).join("\n");
    assert!(text.contains("etude watch") && text.contains("the trainings continue"), "{text}");
    assert!(press(&mut view, KeyCode::Esc), "it closes the help first");
    assert!(!press(&mut view, KeyCode::Esc) && !press(&mut view, KeyCode::Char('q')));
}

#[test]
fn any_size_is_drawn_and_a_tiny_one_says_so() {
    let (_folder, mut view) = two_runs(true);
    for help in [false, true] {
        view.help = help;
        for (width, height) in [(1, 1), (0, 0), (71, 40), (72, 15), (72, 16), (73, 17), (110, 30), (300, 99)]
        {
            drawn(&view, width, height);
        }
    }
    view.help = false;
    let text = lines(&drawn(&view, 40, 8)).join(" ");
    assert!(text.contains("needs 72 × 16 characters, this terminal has 40 × 8"), "{text}");
    let wide = lines(&drawn(&view, 120, 30));
    assert!(wide[0].contains("song") && wide[1].contains("Twinkle"), "{wide:#?}");
}

#[test]
fn a_run_that_has_not_logged_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("new");
    write_run(&run, "New", 0, 0.0);
    let mut view = View::new(vec![run.clone()], true).unwrap();
    let text = lines(&drawn(&view, 80, 24));
    assert!(text[1].ends_with("waiting"), "{text:#?}");
    assert!(text.iter().any(|line| line.starts_with(" a New · waiting for the first log line")), "{text:#?}");
    write_run(&run, "New", 1, 0.0);
    view.read().unwrap();
    let text = lines(&drawn(&view, 80, 24)).join("\n");
    assert!(text.contains("no evaluation yet; the first comes at step 2k"), "{text}");
}

#[test]
fn runs_that_begin_come_after_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    ["a", "b", "c"].iter().for_each(|name| write_run(&path(name), name, 2, 0.5));
    let mut view = View::new(vec![folder.path().to_path_buf()], true).unwrap();
    let names = |view: &View| view.figures.iter().map(|run| run.name.clone()).collect::<Vec<_>>();
    let before = names(&view);
    std::fs::remove_dir_all(path(&before[1])).unwrap();
    write_run(&path("new"), "new", 2, 0.5);
    view.search();
    assert_eq!(names(&view), [&before[0], &before[2], "new"]);
    std::fs::remove_dir_all(path(&before[0])).unwrap();
    view.selected = 2;
    view.search();
    assert_eq!((names(&view), view.selected), (vec![before[2].clone(), "new".to_string()], 1));
}

#[test]
fn more_runs_than_fit_scroll() {
    let folder = tempfile::tempdir().unwrap();
    let runs: Vec<_> = (0..12).map(|run| folder.path().join(format!("run-{run:02}"))).collect();
    runs.iter().for_each(|run| write_run(run, "Song", 4, 0.5));
    let mut view = View::new(runs, true).unwrap();
    view.read().unwrap();
    view.selected = 11;
    let text = lines(&drawn(&view, 80, 24)).join("\n");
    assert!(
        text.contains("l run-11") && !text.contains("run-00") && text.contains("F1 over steps"),
        "{text}"
    );
}
