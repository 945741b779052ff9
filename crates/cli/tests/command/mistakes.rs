//! What people get wrong, and what they are told: one line that helps, no panic, nothing
//! half-written.

use crate::{Sandbox, errors, succeed};

/// `etude ARGS` must fail with one of the documented codes and a short message with all of `words`.
fn refused(sandbox: &Sandbox, args: &str, words: &[&str]) {
    let output = sandbox.command(args).output().unwrap();
    let said = errors(&output);
    let code = output.status.code();
    assert!(matches!(code, Some(1 | 2)), "`etude {args}` ended with {code:?}: {said}");
    assert!(!said.contains("panicked"), "`etude {args}`: {said}");
    assert!(words.iter().all(|word| said.contains(word)), "`etude {args}` should say {words:?}: {said}");
    // clap adds its usage; our own messages are one line.
    assert!(code == Some(2) || said.lines().count() == 1, "`etude {args}`: {said}");
    assert_eq!(output.stdout, b"", "`etude {args}`");
}

#[test]
fn songs_that_cannot_be_had() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("empty.mid"), "").unwrap();
    std::fs::write(sandbox.path("garbage.mid"), "not music at all").unwrap();
    sandbox.write_song("low.mid", [24, 36, 48]);
    let before = sandbox.left_behind().len();
    for verb in ["train", "play", "songs show"] {
        refused(&sandbox, &format!("{verb} twinckle"), &["did you mean twinkle?", "etude songs"]);
        refused(&sandbox, &format!("{verb} absent.mid"), &["absent.mid", "No such file"]);
        refused(&sandbox, &format!("{verb} empty.mid"), &["empty.mid", "the file is empty"]);
        refused(&sandbox, &format!("{verb} garbage.mid"), &["garbage.mid", "not a Standard MIDI File"]);
    }
    for verb in ["train", "play"] {
        let output = sandbox.command(&format!("{verb} low.mid")).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{verb}");
        let said = errors(&output);
        assert!(
            ["low", "C1 (24)", "+12", "Transpose"].iter().all(|word| said.contains(word)),
            "{verb}: {said}"
        );
    }
    refused(
        &sandbox,
        "songs show twinkle --set task.initial_silence_secs=nan",
        &["initial_silence_secs is NaN"],
    );
    assert_eq!(sandbox.left_behind().len(), before, "{:?}", sandbox.left_behind());
}

/// A file that the command itself has not written is not replaced; one that it has is.
#[test]
fn files_that_a_command_has_not_written_are_not_replaced() {
    let sandbox = Sandbox::new();
    let mine = |name: &str| std::fs::write(sandbox.path(name), "mine").unwrap();
    mine("worlds");
    refused(&sandbox, "evaluate short.mid --scripted --worlds 1 -o worlds", &["folder worlds", "another"]);
    assert_eq!(sandbox.bytes("worlds"), b"mine");
    for (args, file) in [
        ("model export -o world.xml", "world.xml"),
        ("export onnx twinkle -o hand.onnx", "hand.onnx"),
        ("songs show twinkle --frames due.csv", "due.csv"),
        ("songs show twinkle --reference due.wav", "due.wav"),
        ("songs make --seed 7 -o melody.mid", "melody.mid"),
        ("songs arrange twinkle --transpose 2 -o higher.mid", "higher.mid"),
    ] {
        mine(file);
        refused(&sandbox, args, &[file, "exists", "choose another name"]);
        assert_eq!(sandbox.bytes(file), b"mine", "{args}");
        std::fs::remove_file(sandbox.path(file)).unwrap();
        sandbox.ok(args);
        let written = sandbox.bytes(file);
        sandbox.ok(args);
        assert_eq!(sandbox.bytes(file), written, "{args}");
    }
    // Another piece of music.
    refused(&sandbox, "songs arrange twinkle --transpose 3 -o higher.mid", &["higher.mid", "exists"]);
    // A training that would write into a folder of the user's, here that of the song.
    std::fs::create_dir(sandbox.path("mine")).unwrap();
    for file in ["mine/song.mid", "mine/config.toml", "mine/meta.json", "mine/metrics.jsonl"] {
        mine(file);
        refused(
            &sandbox,
            "train short.mid -o mine",
            &[file, "is not of a training", "choose another folder"],
        );
        assert!(!sandbox.path("mine/run.lock").exists());
        assert_eq!(sandbox.bytes(file), b"mine");
        std::fs::remove_file(sandbox.path(file)).unwrap();
    }
    // The fit of another rig.
    mine("rail.mcap");
    refused(
        &sandbox,
        "record --robot twin --excitation rail -o rail.mcap",
        &["rail.mcap", "exists", "choose another name"],
    );
    assert_eq!(sandbox.bytes("rail.mcap"), b"mine");
    std::fs::remove_file(sandbox.path("rail.mcap")).unwrap();
    sandbox.ok("record --robot twin --excitation rail -o rail.mcap");
    std::fs::create_dir(sandbox.path("fit")).unwrap();
    std::fs::write(sandbox.path("fit/identification.json"), r#"{"rig": "kitchen"}"#).unwrap();
    refused(&sandbox, "identify rail.mcap -o fit", &["another rig, `kitchen`", "are of `twin (standard)`"]);
    // A twin with another parameter set is another rig.
    sandbox.ok("record --robot twin --twin-params mild --excitation chirp -o chirp.mcap");
    let both = &["chirp.mcap: it was made on the rig `twin (mild)`, and rail.mcap on `twin (standard)`"];
    refused(&sandbox, "identify rail.mcap chirp.mcap -o other", both);
}

#[test]
fn settings_that_cannot_work() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("broken.toml"), "[trainer").unwrap();
    let cases: &[(&str, &[&str])] = &[
        ("--set trainer.sead=3", &["trainer.sead", "expected one of", "seed"]),
        ("--set trainer.seed=-3", &["trainer.seed"]),
        ("--set trainer.seed=many", &["trainer.seed", "many"]),
        ("--set trainer.num_envs=100000000000", &["trainer.num_envs", "from 1 to 4096"]),
        ("--set trainer.num_envs=0", &["trainer.num_envs"]),
        ("--set droq.batch=0", &["droq.batch", "from 1"]),
        ("--set droq=3", &["droq"]),
        ("--set seed", &["path=value"]),
        ("--set =3", &["trainer", "droq", "task"]),
        ("--set task.physics.nonsense=1", &["nonsense", "etude model params"]),
        ("--set task.physics.key.threshold=nan", &["key.threshold"]),
        ("--set task.reward.nonsense=1", &["nonsense", "key_press"]),
        ("--preset slow", &["slow", "fast, expressive, paper, appendix"]),
        ("--config absent.toml", &["absent.toml", "No such file"]),
        ("--config broken.toml", &["broken.toml", "TOML"]),
        ("--set task.randomisation.widths.key.colour=1", &["key.colour", "etude model params"]),
        ("--set task.randomisation.widths.key.threshold=-1", &["key.threshold = -1", "at least 0"]),
        ("--set task.randomisation.widths=wide", &["task.randomisation.widths", "paper"]),
        ("--from absent", &["no policy `absent`", "one that comes with Étude"]),
        ("--from .", &["holds no policy to begin with"]),
        ("--from broken.toml", &["broken.toml cannot be used"]),
        ("--minutes -1", &["--minutes", "above 0"]),
        ("--minutes nan", &["--minutes", "above 0"]),
        ("--minutes 1e300", &["--minutes"]),
        ("--colour", &["--colour"]),
    ];
    for (args, words) in cases {
        refused(&sandbox, &format!("train short.mid {args}"), words);
    }
    refused(&sandbox, "train", &["SONG"]);
    assert_eq!(sandbox.left_behind(), ["broken.toml"]);
}

#[test]
fn runs_that_are_none_or_are_one_already() {
    let sandbox = Sandbox::new();
    refused(&sandbox, "train --resume absent", &["absent holds no run to continue", "etude train"]);
    refused(&sandbox, "train --resume .", &["holds no run to continue"]);
    assert_eq!(sandbox.left_behind().len(), 0);
    // A run of another program, or of another version of this one.
    sandbox.write_song("foreign-song.mid", [60, 62, 64]);
    std::fs::create_dir(sandbox.path("foreign")).unwrap();
    std::fs::rename(sandbox.path("foreign-song.mid"), sandbox.path("foreign/song.mid")).unwrap();
    std::fs::write(sandbox.path("foreign/config.toml"), "steps = 1\n").unwrap();
    refused(&sandbox, "train --resume foreign", &["the training in foreign cannot be continued", "`steps`"]);

    // A training that has failed before its first checkpoint is started again, with other settings
    // too.
    refused(
        &sandbox,
        "train short.mid -o run --set droq.replay_capacity=2147483648",
        &["droq.replay_capacity"],
    );
    assert!(
        sandbox.path("run/meta.json").is_file() && !sandbox.path("run/checkpoints/last.safetensors").exists()
    );
    std::fs::remove_file(sandbox.path("run/song.mid")).unwrap();
    succeed(sandbox.tiny("short.mid -o run --json"));
    let before = sandbox.bytes("run/checkpoints/last.safetensors");
    refused(&sandbox, "train short.mid -o run", &["`etude train --resume run` continues it", "-o"]);
    refused(
        &sandbox,
        "train --resume run --set droq.batch=32",
        &["`droq.batch` cannot be changed", "total_steps"],
    );
    refused(&sandbox, "train --resume run --set task.reward.collision=0", &["`task.reward.collision`"]);
    refused(&sandbox, "train --resume run --preset paper", &["--preset"]);
    refused(&sandbox, "train short.mid --resume run", &["--resume"]);
    refused(&sandbox, "train --resume run --from run", &["--from"]);
    assert_eq!(sandbox.bytes("run/checkpoints/last.safetensors"), before);

    let config = String::from_utf8(sandbox.bytes("run/config.toml")).unwrap();
    assert!(config.contains("lookahead = 5"));
    std::fs::write(sandbox.path("run/config.toml"), config.replace("lookahead = 5", "lookahead = 6"))
        .unwrap();
    refused(&sandbox, "train --resume run", &["the `task` of run/config.toml", "put it back"]);
    std::fs::remove_file(sandbox.path("run/config.toml")).unwrap();
    refused(&sandbox, "train --resume run", &["without its config.toml", "put it back"]);
    std::fs::write(sandbox.path("run/config.toml"), config).unwrap();

    std::fs::write(sandbox.path("run/checkpoints/last.safetensors"), &before[..before.len() / 2]).unwrap();
    refused(&sandbox, "train --resume run", &["last.safetensors", "damaged"]);
    std::fs::remove_file(sandbox.path("run/checkpoints/last.safetensors")).unwrap();
    refused(&sandbox, "train --resume run", &["no checkpoint"]);
    refused(&sandbox, "train short.mid -o run", &["run holds a training without its checkpoint"]);
    std::fs::remove_file(sandbox.path("run/policy-last.safetensors")).unwrap();
    refused(&sandbox, "train short.mid -o run", &["run holds a training without its checkpoint"]);
}

/// The source differs in its song, its observation, its networks: each is told apart, and no folder
/// is made.
#[test]
fn beginnings_that_do_not_fit() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run --json"));
    for source in ["run", "run/policy-best.safetensors"] {
        let from = |rest: &str| format!("train {rest} --from {source} -o new");
        refused(&sandbox, &from("twinkle"), &["`short`", "Twinkle", source, "--from"]);
        refused(&sandbox, &from("short.mid"), &["[16, 16]", "[128, 128, 128]", "droq.hidden"]);
        refused(&sandbox, &from("short.mid --set task.lookahead=2"), &["task.lookahead is 5", "this one 2"]);
        refused(
            &sandbox,
            &from("short.mid --set task.previous_joints=false"),
            &["task.previous_joints is true"],
        );
        refused(
            &sandbox,
            &from("short.mid --set task.stage.side=right"),
            &["task.stage.side", "left", "right"],
        );
        refused(&sandbox, &from("short.mid --set task.scale=si"), &["task.scale", "normalised", "si"]);
    }
    let path = sandbox.path("run/checkpoints/last.safetensors");
    let checkpoint = std::fs::read(&path).unwrap();
    std::fs::write(&path, &checkpoint[..checkpoint.len() / 2]).unwrap();
    refused(&sandbox, "train short.mid --from run -o new", &["last.safetensors", "damaged"]);
    assert_eq!(sandbox.left_behind(), ["run"]);
    refused(&sandbox, "evaluate short.mid --policy run --worlds 0", &["--worlds"]);
    refused(
        &sandbox,
        "evaluate short.mid --policy run --intensity 2",
        &["randomisation.intensity", "from 0 to 1"],
    );
    refused(&sandbox, "evaluate short.mid --policy run --worlds 1 -o /proc/x.csv", &["/proc/x.csv"]);
}

#[test]
fn policies_that_cannot_play() {
    let sandbox = Sandbox::new();
    refused(&sandbox, "play short.mid --policy absent", &["no policy `absent`", "one that comes with Étude"]);
    refused(&sandbox, "play short.mid --policy .", &["holds no policy"]);
    refused(&sandbox, "play short.mid --policy short.mid", &["short.mid cannot be used"]);
    succeed(sandbox.tiny("short.mid -o run --json"));
    let mut policy = sandbox.bytes("run/policy-best.safetensors");
    policy.truncate(policy.len() - 100);
    std::fs::write(sandbox.path("half.safetensors"), policy).unwrap();
    refused(&sandbox, "play short.mid --policy half.safetensors", &["half.safetensors", "damaged"]);
    refused(&sandbox, "play short.mid --policy run --set task.lookahead=2", &["another observation"]);
    refused(&sandbox, "play short.mid --policy run --set task.lookahed=2", &["task.lookahed"]);
    refused(&sandbox, "play short.mid --policy run --soundfont short.mid", &["short.mid", "SoundFont"]);
    assert!(!sandbox.path("out").exists());
}

/// `/proc` takes no folders, not even from root, for whom permissions mean nothing.
#[test]
fn places_that_cannot_be_written() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run --json"));
    for place in ["/proc/etude", "short.mid", "short.mid/below"] {
        refused(&sandbox, &format!("train short.mid -o {place}"), &[place, "-o"]);
        refused(&sandbox, &format!("play short.mid --policy run -o {place}"), &[place, "-o"]);
    }
    refused(&sandbox, "model export -o /proc/world.xml", &["/proc/world.xml"]);
    refused(&sandbox, "model export -o no/such/world.xml", &["no/such/world.xml", "create the folder first"]);
}

/// A disk fails, or a file is copied half: nothing plays or is trained further with wrong numbers,
/// and what is whole is named.
#[test]
fn damaged_files_are_noticed_and_what_is_left_is_named() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run"));
    let damage = |name: &str| {
        let (mut bytes, whole) = (sandbox.bytes(name), sandbox.bytes(name));
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(sandbox.path(name), bytes).unwrap();
        whole
    };
    let whole = damage("run/policy-best.safetensors");
    refused(&sandbox, "play short.mid --policy run", &["policy-best.safetensors", "damaged", "checksum"]);
    std::fs::write(sandbox.path("run/policy-best.safetensors"), whole).unwrap();
    damage("run/checkpoints/last.safetensors");
    let resume = "train --resume run --set trainer.total_steps=800";
    refused(&sandbox, resume, &["checkpoints/last.safetensors", "checksum", "its policy is not damaged"]);
    let begin = "train run/song.mid --config run/config.toml --from run/policy-best.safetensors -o again";
    let said = errors(&sandbox.command(resume).output().unwrap());
    assert!(said.contains(&format!("`etude {}`", begin.replace("again", "DIR"))), "{said}");
    assert!(sandbox.ok(begin).contains("from run/policy-best.safetensors"));

    sandbox.write_song("again/song.mid", [60, 62, 67]);
    let resume = "train --resume again --set trainer.total_steps=800";
    refused(&sandbox, resume, &["again/song.mid is not the song", "put it back"]);
}

/// Somebody corrects a note in the file and goes on as if nothing had happened.
#[test]
fn a_song_that_has_changed_under_its_name_is_told_from_the_one_that_was_learned() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o runs/short__fast__0"));
    let same = sandbox.command("play short.mid --policy runs/short__fast__0 -o before").output().unwrap();
    assert!(same.status.success() && errors(&same).is_empty(), "{}", errors(&same));
    sandbox.write_song("short.mid", [60, 62, 65]);
    for (play, said) in [
        ("play short.mid -o after", "`short.mid` is not the song that the policies named `short` learned: "),
        (
            "play short.mid -o after --policy runs/short__fast__0",
            "warning: this policy learned another `short`",
        ),
    ] {
        let other = sandbox.command(play).output().unwrap();
        assert!(other.status.success() && errors(&other).starts_with(said), "{}", errors(&other));
    }
    let refused = sandbox.tiny("short.mid -o runs/short__fast__0").output().unwrap();
    let said = errors(&refused);
    assert!(
        refused.status.code() == Some(1) && said.contains("holds a training of another `short`"),
        "{said}"
    );
}

/// `etude ARGS` must be refused as a wrong command line, with a message that has all of `words`.
fn redirected(sandbox: &Sandbox, args: &str, words: &[&str]) {
    refused(sandbox, args, words);
    assert_eq!(sandbox.command(args).output().unwrap().status.code(), Some(2), "`etude {args}`");
}

#[test]
fn a_wrong_word_gets_the_near_one_wherever_it_belongs() {
    let sandbox = Sandbox::new();
    let cases: &[(&str, &[&str])] = &[
        ("trian", &["did you mean `etude train`?"]),
        ("trian twinkle --minutes 1", &["did you mean `etude train twinkle --minutes 1`?"]),
        ("check", &["did you mean `etude robot check`?"]),
        ("home --robot lab.toml", &["did you mean `etude robot home --robot lab.toml`?"]),
        ("calibrate", &["did you mean `etude robot calibrate`?"]),
        ("calibrat", &["did you mean `etude robot calibrate`?"]),
        ("stop", &["did you mean `etude robot stop`?"]),
        ("show twinkle", &["did you mean `etude songs show twinkle`?"]),
        ("songs twinkel", &["did you mean `etude songs show twinkle`?"]),
        ("experiment lis", &["did you mean `etude experiment list`?"]),
        ("songs my-song.mid", &["did you mean `etude songs show my-song.mid`?"]),
        ("params --json", &["did you mean `etude model params --json`?"]),
        ("robot train", &["did you mean `etude train`?"]),
        ("songs twinkle", &["did you mean `etude songs show twinkle`?"]),
        ("twinkle", &["`etude train twinkle`", "`etude play twinkle`"]),
        ("experiment songs", &["`etude experiment run songs`"]),
        (
            "play twinkle --twin-params worn",
            &["--twin-params", "is an option of `etude perform`", "`etude twin`"],
        ),
        ("doctor --joints", &["is an option of `etude robot check`"]),
        ("play twinkle --polic x", &["--policy"]),
        ("train twinkle --preset fsat", &["'fsat'", "similar value exists: 'fast'"]),
        ("rehearse twinkle --preset fsat", &["similar value exists: 'fast'"]),
        ("completions bahs", &["similar value exists: 'bash'"]),
        ("completions powershell", &["invalid value 'powershell'", "[possible values: bash, zsh, fish]"]),
    ];
    for (args, words) in cases {
        redirected(&sandbox, args, words);
    }
    refused(&sandbox, "train twinkle --set trainer.sead=3", &["did you mean seed?"]);
    refused(&sandbox, "train twinkle --set seed=3", &["did you mean trainer.seed?"]);
    let params = "task.physics.key.treshold=0.6";
    refused(&sandbox, &format!("train twinkle --set {params}"), &["did you mean key.threshold?"]);
    // A command line is given back as it is typed.
    let output = sandbox.command("show").arg("it's mine.mid").output().unwrap();
    assert!(errors(&output).contains(r#"`etude songs show "it's mine.mid"`"#), "{}", errors(&output));
}

/// A song is text, and so must its name be; any path of a result may be odd.
#[test]
fn a_name_that_is_no_text_is_named() {
    use std::os::unix::ffi::OsStrExt as _;
    let sandbox = Sandbox::new();
    let mut command = sandbox.command("songs show");
    let output = command.arg(std::ffi::OsStr::from_bytes(b"m\xf6we.mid")).output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(2) && said.contains("we.mid` is not valid UTF-8"), "{said}");
    assert!(said.contains("mv OLD NEW"), "{said}");
}
