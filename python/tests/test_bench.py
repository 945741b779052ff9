"""The table of `benches/run.py`, from figures as Étude and the peers print them."""

import importlib.util
import pathlib

spec = importlib.util.spec_from_file_location("run", pathlib.Path(__file__).parents[2] / "benches" / "run.py")
run = importlib.util.module_from_spec(spec)
spec.loader.exec_module(run)


def figures(**values):
    """What Étude prints, of some rows."""
    rows = [
        ("training, `paper` preset, 2 cores", "train_steps_per_sec", "steps/s", 300.0),
        ("the same in bf16, 2 cores", "bf16_train_steps_per_sec", "steps/s", 400.0),
        ("environment, 1 core", "env_steps_per_sec", "control steps/s", 2000.0),
        ("the bare mj_step calls", "bare_steps_per_sec", "control steps/s", 2100.0),
        ("full DroQ update, 1 thread", "updates_per_sec", "updates/s", 200.0),
        ("peak memory of a training, begun", "peak_memory_mib", "MiB", None),
        ("start to the first step, training", "start_up_secs", "s", 0.04),
    ]
    described = [{"what": what, "key": key, "unit": unit} for what, key, unit, _ in rows]
    own = {key: value for _, key, _, value in rows}
    return {"machine": "a computer", "cores": 2, "env_overhead": 0.05, "rows": described} | own | values


def test_medians_ratios_and_failures():
    ours = [figures(), figures(train_steps_per_sec=500.0), figures(train_steps_per_sec=310.0)]
    sbx = {"peer": "SBX", "peak_memory_mib": 1200.0, "start_up_secs": 8.0}
    lines = {
        ("sbx_droq.sh", 1): [sbx | {"steps_per_sec": 60.0}],
        ("sbx_droq.sh", 2): [sbx | {"steps_per_sec": rate} for rate in (50.0, 99.0, 62.0)],
        ("robopianist.sh", 1): [
            {"peer": f"RoboPianist, {hands}", "control_steps_per_sec": rate, "start_up_secs": 2.0}
            for hands, rate in [("one hand", 400.0), ("two hands", 250.0)]
        ],
    }
    failed = {("jax_update.sh", 1): "no network"}
    text = run.report(ours, lines, failed)
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    assert cells[0] == ["what", "Étude", "peer", "peer's", "ratio"] and set("".join(cells[1])) == {"-"}
    assert cells[2:] == [
        ["training, `paper` preset, 2 cores", "310 steps/s", "SBX", "62.0", "5.00"],
        ["the same in bf16 (peers: f32), 2 cores", "400 steps/s", "SBX", "62.0", "6.45"],
        ["environment, 1 core", "2000 control steps/s", "the bare mj_step calls", "2100", "0.95"],
        ["", "", "RoboPianist, one hand", "400", "5.00"],
        ["", "", "RoboPianist, two hands", "250", "8.00"],
        ["full DroQ update, 1 thread", "200 updates/s", "", "", ""],
        ["peak memory of a training, begun", "unknown", "SBX", "1200", "unknown"],
        ["start to the first step, training", "0.04 s", "SBX", "8.00", "200.00"],
        ["", "", "RoboPianist, one hand", "2.00", "50.00"],
        ["", "", "RoboPianist, two hands", "2.00", "50.00"],
    ]
    assert len({len(line) for line in text.splitlines() if line[:1] == "|"}) == 1
    assert "takes 5.0 % more time" in text and text.endswith("jax_update.sh 1 did not run: no network")


def test_every_figure_with_peers_has_scripts():
    scripts = {script for _, peers in run.plan(2).values() for script, _ in peers}
    assert all((run.HERE / "peers" / script).is_file() for script in scripts)
    assert all(threads == 1 for _, peers in run.plan(1).values() for _, threads in peers)


def test_a_peer_that_fails_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "HERE", tmp_path)
    (tmp_path / "peers").mkdir()
    for name, text in [("good.sh", "echo note; echo '{\"peer\": \"P\"}'"), ("bad.sh", "echo why >&2; exit 1"), ("dumb.sh", "")]:
        (tmp_path / "peers" / name).write_text(text)
    assert run.run_peer("good.sh", 1, 1, []) == ([{"peer": "P"}], None)
    assert run.run_peer("bad.sh", 1, 1, []) == ([], "why")
    assert run.run_peer("dumb.sh", 1, 1, []) == ([], "it has printed no figures")
