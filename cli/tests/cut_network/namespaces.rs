//! Two machines with a cable between them, as network namespaces of Linux. The test itself is on one of them.

use std::process::Command;
use zk0_testkit::own_process::{alone, is_alone};

/// The other machine's name, and its address.
const OTHER: &str = "other";
pub const ADDRESS: &str = "10.71.0.1";

/// A command that runs another one in namespaces of its own.
const UNSHARE: [&str; 6] = [
    "unshare",
    "--user",
    "--map-root-user",
    "--net",
    "--mount",
    "--kill-child",
];

/// Whether this process runs in namespaces of its own. If not, runs this test there, and waits for its end.
pub fn inside(test: &str) -> bool {
    (is_alone() || are_allowed()) && alone(&format!("cut_network::{test}"), &UNSHARE)
}

/// Whether this machine allows namespaces.
fn are_allowed() -> bool {
    let mut command = Command::new(UNSHARE[0]);
    let tried = command.args(&UNSHARE[1..]).args(["ip", "link"]).status();
    let allowed = tried.as_ref().is_ok_and(|status| status.success());
    if !allowed {
        zk0_testkit::skipped::skipped(format!(
            "this machine allows no network namespaces: {tried:?}"
        ));
    }
    allowed
}

fn run(command: &str) {
    let mut words = command.split(' ');
    let status = Command::new(words.next().unwrap()).args(words).status();
    assert!(status.unwrap().success(), "{command}");
}

/// The cable between this machine and the other.
pub struct Cable;

impl Cable {
    /// Lays it.
    pub fn lay() -> Self {
        // `ip` keeps the names of namespaces there.
        run("mount -t tmpfs tmpfs /run");
        run(&format!("ip netns add {OTHER}"));
        run(&format!(
            "ip link add name here type veth peer name there netns {OTHER}"
        ));
        run("ip address add 10.71.0.2/24 dev here");
        run(&format!("ip -n {OTHER} address add {ADDRESS}/24 dev there"));
        run("ip link set lo up");
        run("ip link set here up");
        let cable = Self;
        cable.mend();
        cable
    }

    /// From now on, nothing gets through, and nobody is told.
    pub fn cut(&self) {
        run(&format!("ip -n {OTHER} link set there down"));
    }

    pub fn mend(&self) {
        run(&format!("ip -n {OTHER} link set there up"));
    }
}

/// A command that runs on the other machine.
pub fn there(command: &Command) -> Command {
    let mut there = Command::new("ip");
    there.args(["netns", "exec", OTHER]);
    there.arg(command.get_program()).args(command.get_args());
    if let Some(folder) = command.get_current_dir() {
        there.current_dir(folder);
    }
    there
}
