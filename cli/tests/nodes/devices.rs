//! `zk0 node join --device`: a device that is not there ends the node at once, and the CPU is the device by default.

use crate::harness::logged;
use crate::harness::network::LocalNetwork;
use std::fs;
use std::path::Path;

#[test]
fn a_device_that_is_not_there_ends_the_node_before_it_connects() {
    let network = LocalNetwork::new();
    network.found(&[]);
    // A device that this machine does not have may come, so systemd tries it again. A wrong name stays wrong.
    for (device, code, why) in [
        (
            "tpu",
            2,
            "no device is called `tpu`; there are `cpu`, `cuda` and `cuda:N`",
        ),
        ("cuda:987", 1, "device `cuda:987`"),
    ] {
        let output = network.join(1, &["--device", device]);
        let reported = logged(&output);
        assert_eq!(output.status.code(), Some(code), "{reported}");
        assert!(
            reported.contains("--device") && reported.contains(why),
            "{reported}"
        );
        assert!(!Path::new(&network.path("state")).exists(), "{reported}");
    }
}

#[test]
fn a_node_that_names_the_cpu_trains_as_one_that_names_no_device() {
    let updates = [&["--device", "cpu"][..], &[]].map(|device| {
        let network = LocalNetwork::new();
        network.found_with_short_rounds();
        let training = [
            "--steps",
            "200",
            "--batch-size",
            "16",
            "--learning-rate",
            "5e-4",
        ];
        network.joins(1, &[&training[..], device].concat());
        fs::read(network.path("state/round-0.safetensors")).unwrap()
    });
    assert!(updates[0] == updates[1]);
}
