//! The wheel and the Debian package: what goes into them, and of which version. `make wheel` and `make deb` pack and try them.

use super::packaging::reported;
use crate::harness::{root, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use toml::{Table, Value};

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// A TOML file of the repository.
fn table(path: &str) -> Table {
    let text = fs::read_to_string(root().join(path)).unwrap();
    text.parse().unwrap()
}

/// Puts together what the wheel holds.
fn staged(binary: &str, below: &Path) -> Output {
    Command::new(root().join("packaging/wheel/stage.sh"))
        .args([binary, text(below)])
        .current_dir(root())
        .output()
        .unwrap()
}

#[test]
fn the_wheel_carries_the_program_as_a_command() {
    let dir = tempfile::tempdir().unwrap();
    let output = staged(env!("CARGO_BIN_EXE_zk0"), dir.path());
    assert!(output.status.success(), "{}", reported(&output));
    let wheel = dir.path().join(format!("zk0-{VERSION}"));
    // pip takes the program's name and its version from these names.
    let program = wheel.join(format!("zk0-{VERSION}.data/scripts/zk0"));
    let printed = Command::new(program).arg("--version").output().unwrap();
    assert_eq!(reported(&printed), format!("zk0 {VERSION}\n"));
    let info = wheel.join(format!("zk0-{VERSION}.dist-info"));
    let metadata = fs::read_to_string(info.join("METADATA")).unwrap();
    let has = |line: &str| metadata.lines().any(|other| other == line);
    assert!(has("Name: zk0"), "{metadata}");
    assert!(has(&format!("Version: {VERSION}")), "{metadata}");
    let licences: Vec<_> = metadata
        .lines()
        .filter_map(|line| line.strip_prefix("License-File: "))
        .collect();
    assert_eq!(licences.len(), 2);
    for licence in licences {
        assert!(info.join("licenses").join(licence).is_file(), "{licence}");
    }
    // It is of one platform. auditwheel makes a manylinux tag of this one, which PyPI refuses.
    let tags = fs::read_to_string(info.join("WHEEL")).unwrap();
    for line in ["Root-Is-Purelib: false", "Tag: py3-none-linux_x86_64"] {
        assert!(tags.lines().any(|other| other == line), "{tags}");
    }
}

#[test]
fn what_is_no_program_is_not_put_into_a_wheel() {
    let dir = tempfile::tempdir().unwrap();
    let output = staged("Cargo.toml", dir.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(
        reported(&output).contains("Cargo.toml is not a program"),
        "{}",
        reported(&output)
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn flower_depends_on_the_wheel_of_its_own_version() {
    let manifest = table("flower/pyproject.toml");
    let project = &manifest["project"];
    assert_eq!(project["version"].as_str(), Some(VERSION));
    let wanted = Value::from(format!("zk0=={VERSION}"));
    let dependencies = project["dependencies"].as_array().unwrap();
    assert!(dependencies.contains(&wanted), "{dependencies:?}");
    let changes = fs::read_to_string(root().join("CHANGELOG.md")).unwrap();
    assert!(changes.contains(&format!("\n## {VERSION}")), "{changes}");
}

#[test]
fn the_debian_package_has_the_program_its_units_and_its_settings() {
    let manifest = table("cli/Cargo.toml");
    let deb = &manifest["package"]["metadata"]["deb"];
    // These may add to what cargo-deb makes of the units. It writes that in place of #DEBHELPER#.
    assert_eq!(
        deb["maintainer-scripts"].as_str(),
        Some("../packaging/debian")
    );
    for script in ["preinst", "postinst", "prerm", "postrm"] {
        if let Ok(text) = fs::read_to_string(root().join("packaging/debian").join(script)) {
            assert!(text.lines().any(|line| line == "#DEBHELPER#"), "{script}");
        }
    }
    let assets = deb["assets"].as_array().unwrap();
    for asset in [
        ["target/release/zk0", "usr/bin/", "755"],
        [
            "../packaging/systemd/zk0-users.conf",
            "usr/lib/sysusers.d/",
            "644",
        ],
        ["../packaging/config/*.toml", "etc/zk0/", "644"],
        [
            "../packaging/debian/copyright",
            "usr/share/doc/zk0/copyright",
            "644",
        ],
    ] {
        let wanted = Value::from(asset.to_vec());
        assert!(assets.contains(&wanted), "{wanted:?} is not in {assets:?}");
    }
    let mut named = Vec::new();
    for unit in deb["systemd-units"].as_array().unwrap() {
        // A service has neither key nor settings when it is installed. An upgrade restarts it if it runs: without `restart-after-upgrade`,
        // cargo-deb does that.
        let keys: Vec<_> = unit.as_table().unwrap().keys().collect();
        assert_eq!(keys.len(), 4, "{keys:?}");
        for off in ["enable", "start"] {
            assert_eq!(unit[off], Value::Boolean(false), "{unit:?}");
        }
        assert_eq!(unit["unit-scripts"].as_str(), Some("../packaging/systemd"));
        named.push(format!("{}.service", unit["unit-name"].as_str().unwrap()));
    }
    let folder = fs::read_dir(root().join("packaging/systemd")).unwrap();
    let mut units: Vec<_> = folder
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".service"))
        .collect();
    named.sort();
    units.sort();
    assert_eq!(named, units);
}
