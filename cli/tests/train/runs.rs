//! `zk0 train` and `zk0 eval` as processes. A run that is killed at any moment and resumed ends with the same bytes.

use crate::harness::{ends, logged, root, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use zk0_testkit::recordings::{Copy, INFO};
use zk0_testkit::until;

/// `zk0 train` on a recording, micro profile, with a cache in `dir`.
fn train(dir: &Path, out: &str, more: &[&str]) -> Command {
    let mut command = zk0(&["train", "--dataset", RECORDING, "--lr", "2e-3"]);
    command
        .arg("--out")
        .arg(dir.join(out))
        .arg("--cache")
        .arg(dir.join("cache"))
        .args(more);
    command
}

const MICRO: [&str; 10] = [
    "--profile",
    "micro",
    "--steps",
    "120",
    "--batch-size",
    "16",
    "--snapshot-every",
    "7",
    "--eval-episodes",
    "0.2",
];

#[track_caller]
fn succeeds(command: Command) -> Output {
    ends(0, command)
}

#[track_caller]
fn fails(command: Command) -> String {
    logged(&ends(1, command))
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Reads the steps from a file of metrics, and skips lines that are not whole.
fn steps(metrics: &Path) -> Vec<u64> {
    let text = fs::read_to_string(metrics).unwrap_or_default();
    let lines = text
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok());
    lines
        .filter(|line: &Value| line.get("loss").is_some())
        .filter_map(|line| line["step"].as_u64())
        .collect()
}

#[test]
fn a_run_that_is_killed_again_and_again_ends_with_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    succeeds(train(dir.path(), "unbroken", &MICRO));
    let model = |out: &str| fs::read(dir.path().join(out).join("model.safetensors")).unwrap();
    let resumed = [&MICRO[..], &["--resume"]].concat();
    // The test kills the run when the metrics hold this many steps: before the first snapshot, right after a snapshot, and between
    // snapshots.
    for (run, stops) in [[0, 3, 8, 31, 32, 90], [1, 7, 14, 15, 66, 101]]
        .iter()
        .enumerate()
    {
        let out = format!("killed-{run}");
        let metrics = dir.path().join(&out).join("metrics.jsonl");
        let mut kills = 0;
        for stop in stops {
            let mut process = train(dir.path(), &out, &resumed)
                .stderr(Stdio::null())
                .stdout(Stdio::null())
                .spawn()
                .unwrap();
            until("the run has come so far, or has ended", || {
                steps(&metrics).len() >= *stop || process.try_wait().unwrap().is_some()
            });
            // The kill comes at some moment of the next steps. SIGKILL leaves the process no time for anything.
            let clock = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
            sleep(Duration::from_micros(
                u64::from(clock.subsec_nanos()) % 20_000,
            ));
            process.kill().unwrap();
            kills += usize::from(!process.wait().unwrap().success());
        }
        println!("{out}: killed {kills} times");
        assert!(kills >= 4, "it was faster than most kills");
        succeeds(train(dir.path(), &out, &resumed));
        assert!(model("unbroken") == model(&out), "run {run}: other bytes");

        // The metrics hold every step once, in order.
        assert_eq!(steps(&metrics), (1..=120).collect::<Vec<_>>());
    }
}

/// While frames are still prepared in the background, SIGTERM ends a run at once. What is in the cache is whole, and the run goes on.
#[test]
fn sigterm_ends_a_run_that_prepares_frames_in_the_background() {
    let dir = tempfile::tempdir().unwrap();
    let options = ["--profile", "tiny", "--steps", "200", "--batch-size", "8"];
    let options = [&options[..], &["--snapshot-every", "20", "--resume"]].concat();
    succeeds(train(dir.path(), "unbroken", &options));
    fs::remove_dir_all(dir.path().join("cache")).unwrap();

    // A shell that runs the tests in the background lets them ignore signals, and their children too.
    let inner = train(dir.path(), "stopped", &options);
    let mut run = Command::new("env");
    run.arg("--default-signal=TERM").arg(inner.get_program());
    run.args(inner.get_args()).current_dir(root());
    let mut run = run.stderr(Stdio::null()).spawn().unwrap();
    let metrics = dir.path().join("stopped/metrics.jsonl");
    until("the run has begun, or has ended", || {
        !steps(&metrics).is_empty() || run.try_wait().unwrap().is_some()
    });
    let begin = Instant::now();
    let pid = run.id().to_string();
    let told = Command::new("kill").args(["-TERM", &pid]).status();
    assert!(told.unwrap().success());
    assert!(
        !run.wait().unwrap().success(),
        "it was faster than the signal"
    );
    assert!(begin.elapsed() < Duration::from_secs(20));
    assert!(steps(&metrics).len() < 200);

    let log = logged(&succeeds(train(dir.path(), "stopped", &options)));
    assert!(
        log.contains("in the background while the run trains"),
        "{log}"
    );
    assert!(!log.contains("damaged"), "{log}");
    let model = |out: &str| fs::read(dir.path().join(out).join("model.safetensors")).unwrap();
    assert!(model("unbroken") == model("stopped"));
}

#[test]
fn a_run_leaves_its_results_and_they_can_be_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    let options = [&MICRO[..], &["--fedprox-mu", "0.01", "--train-state-proj"]].concat();
    succeeds(train(dir.path(), "out", &options));
    let out = dir.path().join("out");
    let run = json(&out.join("run.json"));
    assert_eq!(run["scope"], "expert-and-state");
    let episodes = &run["recordings"][0]["episodes"];
    let count = |side: &str| episodes[side].as_array().unwrap().len();
    assert_eq!((count("train"), count("eval")), (5, 1));
    let frames = |side: &str| run["recordings"][0][side].as_u64().unwrap();
    assert_eq!(frames("train_frames") + frames("eval_frames"), 245);
    assert!(run["ended"]["held_out"]["loss"].as_f64().unwrap() > 0.0);

    let metrics = fs::read_to_string(out.join("metrics.jsonl")).unwrap();
    let lines: Vec<Value> = metrics
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let evaluated = lines.iter().filter_map(|line| line["eval_loss"].as_f64());
    let evaluated: Vec<f64> = evaluated.collect();
    assert_eq!(evaluated.len(), 11, "before the first step and ten times");
    assert!(evaluated[10] < evaluated[0], "{evaluated:?}");
    assert!(lines.iter().any(|line| line["prox"].as_f64() > Some(0.0)));
    for (file, starts_with) in [("loss.png", &b"\x89PNG"[..]), ("loss.svg", b"<svg")] {
        assert!(
            fs::read(out.join(file)).unwrap().starts_with(starts_with),
            "{file}"
        );
    }
    assert_eq!(json(&out.join("loss.json")).as_array().unwrap().len(), 2);

    let model = out.join("model.safetensors");
    let mut eval = zk0(&["eval", "--profile", "micro", "--json", "--frames", "40"]);
    eval.args([
        "--dataset",
        RECORDING,
        "--dataset",
        "tests/fixtures/datasets/so100_sorting",
    ]);
    eval.arg("--policy").arg(&model);
    eval.arg("--cache").arg(dir.path().join("cache"));
    eval.arg("--out").arg(dir.path().join("eval"));
    let rows: Value = serde_json::from_slice(&succeeds(eval).stdout).unwrap();
    assert_eq!(rows, json(&dir.path().join("eval/eval.json")));
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 4, "two policies on two recordings");
    let loss = |row: usize| rows[row]["loss_valid_only"].as_f64().unwrap();
    assert!(
        loss(0) < loss(2),
        "training on it helped: {} {}",
        loss(0),
        loss(2)
    );
    let joints = rows[0]["action_error"].as_array().unwrap();
    assert_eq!(joints.len(), 6);
    let error = |row: usize| -> f64 {
        let joints = rows[row]["action_error"].as_array().unwrap();
        let errors = joints
            .iter()
            .map(|joint| joint["mean_absolute_error"].as_f64());
        errors.map(Option::unwrap).sum()
    };
    assert!(error(0) < error(2), "{} {}", error(0), error(2));
    let svg = fs::read_to_string(dir.path().join("eval/eval.svg")).unwrap();
    assert!(
        svg.contains("so100_sorting"),
        "the chart names the recordings"
    );
}

/// Options that are not given have the values of LeRobot's preset, with which the reference was trained.
#[test]
fn options_that_are_not_given_are_lerobots_preset() {
    let preset =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/smolvla_tiny/optimizer.json");
    let preset = json(&preset);
    let (adamw, scheduler) = (&preset["optimizer"], &preset["scheduler"]);

    // A run prints all its options, given or not. One step is enough for that.
    let dir = tempfile::tempdir().unwrap();
    let mut command = zk0(&[
        "train",
        "--dataset",
        RECORDING,
        "--profile",
        "micro",
        "--steps",
        "1",
    ]);
    command.arg("--out").arg(dir.path().join("out"));
    command.arg("--cache").arg(dir.path().join("cache"));
    succeeds(command);
    let run = json(&dir.path().join("out/run.json"));
    let options = &run["options"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}"));
    let (ours, schedule) = (&options["adamw"], &options["schedule"]);
    assert_eq!(number(&ours["beta1"]), number(&adamw["betas"][0]));
    assert_eq!(number(&ours["beta2"]), number(&adamw["betas"][1]));
    assert_eq!(number(&ours["eps"]), number(&adamw["eps"]));
    assert_eq!(
        number(&ours["weight_decay"]),
        number(&adamw["weight_decay"])
    );
    assert_eq!(number(&ours["clip_norm"]), number(&adamw["grad_clip_norm"]));
    assert_eq!(number(&options["learning_rate"]), number(&adamw["lr"]));
    assert_eq!(schedule["kind"], "warmup-cosine");
    assert_eq!(schedule["warmup"], scheduler["num_warmup_steps"]);
    assert_eq!(schedule["decay"], scheduler["num_decay_steps"]);
    let floor = number(&scheduler["decay_lr"]) / number(&scheduler["peak_lr"]);
    assert_eq!(number(&schedule["floor"]), floor);
    assert_eq!(number(&options["fedprox_mu"]), 0.0);
    // LeRobot's TrainPipelineConfig has this batch size.
    assert_eq!(options["batch_size"], 8);

    // The default number of steps is the length of the cosine.
    let help = succeeds(zk0(&["train", "--help"]));
    let help = String::from_utf8(help.stdout).unwrap();
    let steps = help.split("--steps <STEPS>").nth(1).unwrap();
    let steps = steps.split("[default: ").nth(1).unwrap();
    let steps = steps.split(']').next().unwrap();
    assert_eq!(steps, scheduler["num_decay_steps"].to_string());
}

/// Frames prepared in one precision are never used in another. This holds for the cache that both runs share, and for a run that
/// goes on.
#[test]
fn the_frozen_halfs_precision_is_a_runs_own() {
    let dir = tempfile::tempdir().unwrap();
    let run = |out: &str, precision: &str, more: &[&str]| {
        let options = ["--profile", "micro", "--steps", "3", "--frozen-precision"];
        train(
            dir.path(),
            out,
            &[&options[..], &[precision], more].concat(),
        )
    };
    let model = |out: &str| fs::read(dir.path().join(out).join("model.safetensors")).unwrap();
    for out in ["bf16", "f32"] {
        succeeds(run(out, out, &[]));
        let report = json(&dir.path().join(out).join("run.json"));
        assert_eq!(report["frozen_precision"], out);
    }
    assert!(model("f32") != model("bf16"));
    succeeds(train(
        dir.path(),
        "usual",
        &["--profile", "micro", "--steps", "3"],
    ));
    assert!(model("f32") == model("usual"), "f32 is the CPU's own");
    let other = fails(run("bf16", "f32", &["--resume"]));
    assert!(other.contains("another run"), "{other}");

    let loss = |precision: &str| {
        let mut eval = zk0(&["eval", "--profile", "micro", "--json", "--frames", "8"]);
        eval.args(["--dataset", RECORDING, "--frozen-precision", precision]);
        eval.arg("--cache").arg(dir.path().join("cache"));
        let rows: Value = serde_json::from_slice(&succeeds(eval).stdout).unwrap();
        rows[0]["loss_valid_only"].as_f64().unwrap()
    };
    let (exact, rounded) = (loss("f32"), loss("bf16"));
    assert!(exact != rounded && (rounded / exact - 1.0).abs() < 0.01);

    let unknown = run("new", "fp8", &[]).output().unwrap();
    assert_eq!(unknown.status.code(), Some(2));
    assert!(logged(&unknown).contains("`fp8`"), "{}", logged(&unknown));
}

/// What `zk0 train` asks of recordings, `zk0 eval` asks, too.
#[test]
fn recordings_that_do_not_fit_the_policy_or_each_other_are_not_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    let eval = |more: &[&str]| {
        let mut eval = zk0(&["eval", "--frames", "2", "--dataset", RECORDING]);
        eval.args(more);
        eval.arg("--cache").arg(dir.path().join("cache"));
        fails(eval)
    };
    let other = Copy::default();
    other.edit_text(INFO, "\"main_gripper\"", "\"gripper.pos\"");
    let other = other.root().to_str().unwrap();
    let different = eval(&["--profile", "micro", "--dataset", other]);
    assert!(
        different.contains("\"gripper.pos\"], not [\"main_"),
        "{different}"
    );
    // This policy takes states of 5 dimensions and actions of 4.
    let odd = eval(&["--policy", "tests/fixtures/smolvla_odd"]);
    let reports = "has 6 state and 6 action dimensions, and the policy takes 5 and 4";
    assert!(odd.contains(&format!("{RECORDING} {reports}")), "{odd}");
}

#[test]
fn mistakes_are_named_before_anything_is_spent() {
    let dir = tempfile::tempdir().unwrap();
    succeeds(train(
        dir.path(),
        "out",
        &["--profile", "micro", "--steps", "3"],
    ));
    let again = fails(train(
        dir.path(),
        "out",
        &["--profile", "micro", "--steps", "3"],
    ));
    assert!(again.contains("--resume"), "{again}");
    let other = ["--profile", "micro", "--steps", "4", "--resume"];
    let other = fails(train(dir.path(), "out", &other));
    assert!(other.contains("another run"), "{other}");

    let micro = |more: &[&str]| {
        let options = [&["--profile", "micro", "--steps", "2"], more].concat();
        fails(train(dir.path(), "new", &options))
    };
    assert!(micro(&["--batch-size", "0"]).contains("`batch_size` is 0"));
    assert!(
        micro(&["--schedule", "warm-restarts", "--first-period", "0"]).contains("first period")
    );
    assert!(micro(&["--eval-episodes", "1.5"]).contains("held out"));
    assert!(micro(&["--round-losses", "0.5,nan"]).contains("NaN"));
    assert!(micro(&["--device", "tpu"]).contains("no device is called `tpu`"));
    assert!(micro(&["--device", "cuda:987"]).contains("device `cuda:987`"));
    assert!(micro(&["--dataset", "no/such/recording"]).contains("no/such/recording"));
    assert!(micro(&["--dataset", "hub:so100"]).contains("recording hub:so100"));
    let other = Copy::default();
    other.edit_text(INFO, "\"main_gripper\"", "\"gripper.pos\"");
    let different = micro(&["--dataset", other.root().to_str().unwrap()]);
    assert!(
        different.contains("\"gripper.pos\"], not [\"main_"),
        "{different}"
    );
    let policy = ["--policy", "no/such/policy", "--steps", "2"];
    assert!(fails(train(dir.path(), "new", &policy)).contains("no/such/policy"));
    assert!(!dir.path().join("new/snapshots/000002").exists());

    // Another process already writes to this folder.
    let out = dir.path().join("locked");
    fs::create_dir(&out).unwrap();
    let lock = fs::File::create(out.join(".lock")).unwrap();
    lock.lock().unwrap();
    let locked = fails(train(
        dir.path(),
        "locked",
        &["--profile", "micro", "--steps", "2"],
    ));
    assert!(locked.contains("another process"), "{locked}");
}
