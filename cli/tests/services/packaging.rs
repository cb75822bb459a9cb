//! The systemd units with the script that installs them, and the container file.

use crate::harness::{root, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const SERVICES: [&str; 4] = ["aggregator", "node", "prover", "witness"];

/// What a program prints in both its streams.
pub fn reported(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

fn unit(service: &str) -> String {
    let path = format!("packaging/systemd/zk0-{service}.service");
    fs::read_to_string(root().join(path)).unwrap()
}

/// The value of a line `KEY=VALUE` of a unit.
#[track_caller]
fn value<'a>(unit: &'a str, key: &str) -> &'a str {
    let mut values = unit
        .lines()
        .filter_map(|line| line.strip_prefix(key)?.strip_prefix('='));
    values
        .next()
        .unwrap_or_else(|| panic!("there is no {key} in {unit}"))
}

/// Installs the binary below a folder.
fn installed(below: &Path) -> Output {
    Command::new(root().join("packaging/install.sh"))
        .args([env!("CARGO_BIN_EXE_zk0"), text(below)])
        .output()
        .unwrap()
}

#[test]
fn the_script_installs_the_binary_its_settings_and_its_units() {
    let dir = tempfile::tempdir().unwrap();
    let below = dir.path();
    let output = installed(below);
    assert!(output.status.success(), "{}", reported(&output));
    let binary = Command::new(below.join("usr/local/bin/zk0"))
        .arg("--version")
        .output();
    assert!(reported(&binary.unwrap()).starts_with("zk0 "));
    for service in SERVICES {
        // systemd finds the program in /usr/local/bin, where the script puts it, and in /usr/bin, where the Debian package has it.
        let unit =
            fs::read_to_string(below.join(format!("etc/systemd/system/zk0-{service}.service")));
        let unit = unit.unwrap();
        let words: Vec<_> = value(&unit, "ExecStart").split(' ').collect();
        let [program, _, _, "--config", settings] = words[..] else {
            panic!("{words:?}");
        };
        assert_eq!(program, "zk0");
        let settings = below.join(settings.trim_start_matches('/'));
        // What it can write to are the folders of the settings, also of those that are not in force.
        let named = [("StateDirectory=", "lib"), ("CacheDirectory=", "cache")];
        let folders = named.iter().flat_map(|(key, kind)| {
            let names = unit.lines().filter_map(move |line| line.strip_prefix(key));
            names.map(move |name| format!("\"/var/{kind}/{name}"))
        });
        let folders: Vec<_> = folders.collect();
        let settings = fs::read_to_string(settings).unwrap();
        let within_var = settings
            .lines()
            .filter(|line| !line.starts_with("# ") && line.contains("\"/var/"));
        for line in within_var {
            assert!(folders.iter().any(|folder| line.contains(folder)), "{line}");
        }
    }
    // Settings of the operator are kept.
    let settings = below.join("etc/zk0/aggregator.toml");
    fs::write(&settings, "mine").unwrap();
    assert!(installed(below).status.success());
    assert_eq!(fs::read_to_string(&settings).unwrap(), "mine");
}

#[test]
fn what_is_no_program_is_not_installed() {
    let dir = tempfile::tempdir().unwrap();
    let script = root().join("packaging/install.sh");
    let output = Command::new(&script)
        .args(["Cargo.toml", text(dir.path())])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        reported(&output).contains("Cargo.toml is not a program"),
        "{}",
        reported(&output)
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    assert_eq!(
        Command::new(&script).output().unwrap().status.code(),
        Some(2)
    );
}

/// Whether systemd's checker is there.
fn has_analyze() -> bool {
    let there = Command::new("systemd-analyze")
        .arg("--version")
        .output()
        .is_ok();
    if !there {
        zk0_testkit::skipped::skipped("there is no systemd-analyze, so the units are not verified");
    }
    there
}

#[test]
fn systemd_accepts_the_units_and_finds_them_well_confined() {
    if !has_analyze() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for service in SERVICES {
        // The checker wants the program to be there.
        let program = concat!("ExecStart=", env!("CARGO_BIN_EXE_zk0"), " ");
        let unit = unit(service).replace("ExecStart=zk0 ", program);
        let path = dir.path().join(format!("zk0-{service}.service"));
        fs::write(&path, unit).unwrap();
        let analyze = |arguments: &[&str]| {
            let mut command = Command::new("systemd-analyze");
            command.args(arguments).arg(&path).output().unwrap()
        };
        let verified = analyze(&["verify", "--man=no", "--recursive-errors=no"]);
        assert!(verified.status.success(), "{}", reported(&verified));
        assert_eq!(reported(&verified), "", "{service}");
        // 10 is a unit without any confinement, and 0 one that can do nothing. The threshold is in tenths.
        let confined = analyze(&["security", "--offline=yes", "--threshold=25"]);
        assert!(confined.status.success(), "{}", reported(&confined));
    }
}

#[test]
fn a_unit_waits_until_the_service_has_ended() {
    let unit = unit("aggregator");
    let wait: u64 = value(&unit, "TimeoutStopSec").parse().unwrap();
    let example = fs::read_to_string(root().join("packaging/config/aggregator.toml")).unwrap();
    let drain: u64 = value(&example, "#drain-seconds ").trim().parse().unwrap();
    assert!(wait >= drain + 3, "{wait} {drain}");
    for service in SERVICES {
        let unit = self::unit(service);
        assert_eq!(value(&unit, "Restart"), "on-failure");
        // It is started again as often as it takes, unless a setting is wrong.
        assert_eq!(value(&unit, "StartLimitIntervalSec"), "0");
        assert_eq!(value(&unit, "RestartPreventExitStatus"), "2");
        assert_eq!(value(&unit, "ProtectSystem"), "strict");
        // Where a device can be chosen, the unit states how a GPU is let in.
        let example = fs::read_to_string(root().join(format!("packaging/config/{service}.toml")));
        let on_a_gpu = example.unwrap().contains("\n#device = ");
        assert_eq!(unit.contains("PrivateDevices=no"), on_a_gpu, "{service}");
        assert_eq!(
            value(&unit, "EnvironmentFile"),
            format!("-/etc/zk0/{service}.env")
        );
        let users = fs::read_to_string(root().join("packaging/systemd/zk0-users.conf")).unwrap();
        assert!(
            users.contains(&format!("u {} ", value(&unit, "User"))),
            "{users}"
        );
    }
}

/// A builder of images needs a network and half an hour, so this checks what can be seen without one. `make image` builds the image and tries it.
#[test]
fn the_container_file_installs_what_make_builds_and_drops_its_rights() {
    let file = fs::read_to_string(root().join("packaging/Containerfile")).unwrap();
    let steps: Vec<_> = file
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .collect();
    let at = |wanted: &str| {
        let found = steps.iter().position(|step| step.starts_with(wanted));
        found.unwrap_or_else(|| panic!("no step begins with {wanted:?}: {steps:?}"))
    };
    let stages: Vec<_> = steps
        .iter()
        .filter(|step| step.starts_with("FROM "))
        .collect();
    assert_eq!(stages.len(), 2, "{stages:?}");
    let build = at("    make build && cp /target/release/zk0 /usr/local/bin/zk0");
    let installs = at("COPY --from=build /usr/local/bin/zk0 /usr/local/bin/zk0");
    let drops = at("USER 7071:7071");
    assert!(build < installs && installs < drops);
    assert!(steps[drops..].iter().all(|step| !step.starts_with("RUN ")));
    // Without tini, SIGTERM does not end a command that does not ask for it.
    let starts = at(r#"ENTRYPOINT ["/usr/bin/tini", "--", "/usr/local/bin/zk0"]"#);
    assert!(starts > installs && file.contains("libstdc++6 tini"));
    // The ports of all services that listen, as the examples have them.
    let exposed = steps[at("EXPOSE ")];
    for service in SERVICES {
        let example = fs::read_to_string(root().join(format!("packaging/config/{service}.toml")));
        for line in example.unwrap().lines() {
            let listens = line.starts_with("#listen = ") || line.starts_with("#log-listen = ");
            let port = line.trim_end_matches('"').rsplit(':').next();
            if let Some(port) = port.filter(|_| listens) {
                assert!(exposed.contains(port), "{port} is not in {exposed}");
            }
        }
    }
    let version = format!("image.version={:?}", env!("CARGO_PKG_VERSION"));
    assert!(file.contains(&version), "there is no {version}");
}
