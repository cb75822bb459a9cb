//! The annotated examples of `packaging/config` hold every setting of their commands and no other, with the defaults of `--help`.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{self, ends, logged, prints, root, zk0};
use std::collections::BTreeMap;
use std::fs;
use toml::{Table, Value};

/// The examples, and the commands that they are of.
const EXAMPLES: [(&str, [&str; 2]); 4] = [
    ("aggregator.toml", ["aggregator", "serve"]),
    ("node.toml", ["node", "join"]),
    ("prover.toml", ["prover", "serve"]),
    ("witness.toml", ["witness", "serve"]),
];

/// It would be wrong at each start but one.
const ONE_START: &str = "newest-checkpoint";

fn example(name: &str) -> String {
    fs::read_to_string(root().join("packaging/config").join(name)).unwrap()
}

/// An example with every setting that it holds: the lines `#key = value` count.
fn whole(text: &str) -> Table {
    let lines = text.lines().map(|line| match line.strip_prefix('#') {
        Some(setting) if !setting.starts_with([' ', '#']) => setting,
        _ => line,
    });
    let lines: Vec<_> = lines.collect();
    lines.join("\n").parse().unwrap()
}

/// What `--help` states of one setting.
struct Shown {
    text: String,
    default: Option<String>,
    variable: Option<String>,
}

/// The part of a text between `[name: ` and `]`.
fn bracketed(text: &str, name: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("[{name}: "))?;
    Some(rest.split_once(']')?.0.to_owned())
}

/// The settings that `--help` of a command shows.
fn help(command: [&str; 2]) -> BTreeMap<String, Shown> {
    let help = prints(&[&command[..], &["--help"]].concat());
    let mut settings = BTreeMap::<String, String>::new();
    let mut key = None;
    for line in help.lines() {
        let begin = line.trim_start();
        let indent = line.len() - begin.len();
        if let Some(name) = begin.strip_prefix('<').filter(|_| indent == 2) {
            key = name.split_once('>').map(|(name, _)| name.to_lowercase());
        } else if let Some((_, name)) = begin.split_once("--").filter(|_| (2..=6).contains(&indent))
        {
            if begin.starts_with('-') {
                key = name.split([' ', '=']).next().map(str::to_owned);
            }
        } else if !line.is_empty() && indent == 0 {
            key = None;
        }
        if let Some(key) = &key {
            let text = settings.entry(key.clone()).or_default();
            text.push_str(begin);
            text.push(' ');
        }
    }
    for not_in_a_file in ["help", "config"] {
        settings.remove(not_in_a_file).unwrap();
    }
    // An aggregator alone has it, for one start.
    settings.remove(ONE_START);
    let shown = |text: String| Shown {
        default: bracketed(&text, "default"),
        variable: bracketed(&text, "env"),
        text,
    };
    settings
        .into_iter()
        .map(|(key, text)| (key, shown(text)))
        .collect()
}

#[test]
fn each_example_holds_all_settings_of_its_command_and_no_other() {
    for (name, command) in EXAMPLES {
        let (held, shown) = (whole(&example(name)), help(command));
        assert!(shown.len() >= 4, "{name}: {:?}", shown.keys());
        let held: Vec<_> = held.keys().collect();
        let mut sorted = held.clone();
        sorted.sort();
        assert_eq!(sorted, shown.keys().collect::<Vec<_>>(), "{name}");
    }
}

#[test]
fn what_counts_for_one_start_is_in_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("aggregator.toml");
    fs::write(&file, format!("{ONE_START} = 3\n")).unwrap();
    let arguments = ["aggregator", "serve", "--config", harness::text(&file)];
    let refused = logged(&ends(2, zk0(&arguments)));
    let reported = format!("line 1: {ONE_START}: `zk0 aggregator serve` has no such setting");
    assert!(refused.contains(&reported), "{refused}");
}

#[test]
fn each_example_names_the_defaults_that_help_names() {
    for (name, command) in EXAMPLES {
        let text = example(name);
        let held = whole(&text);
        let mut compared = 0;
        for (key, Shown { default, .. }) in help(command) {
            let Some(default) = default else { continue };
            let value = match &held[&key] {
                Value::String(text) => text.clone(),
                Value::Integer(number) => number.to_string(),
                Value::Float(number) => number.to_string(),
                // What `--help` states in words stands in the comment.
                _ => String::new(),
            };
            let reported = format!("Default: {default}");
            assert!(
                value == default || text.replace("\n# ", " ").contains(&reported),
                "{name}: {key} is {value}, and help states {default}"
            );
            compared += 1;
        }
        assert!(compared >= 2, "{name}");
    }
}

#[test]
fn every_setting_has_a_variable_of_its_name() {
    let others = [["ledger", "serve"], ["audit", "watch"]];
    for command in EXAMPLES
        .map(|(_, command)| command)
        .into_iter()
        .chain(others)
    {
        for (key, Shown { variable, text, .. }) in help(command) {
            let named = match key.as_str() {
                "log" => "ZK0_LOG".to_owned(),
                _ => format!("ZK0_{}_{key}", command[0])
                    .replace('-', "_")
                    .to_uppercase(),
            };
            assert_eq!(variable, Some(named), "{text}");
        }
    }
    let help = prints(&["aggregator", "serve", "--help"]);
    assert!(help.contains("A flag counts before the variable"), "{help}");
}

/// Settings that cannot be used, whatever else there is.
const WRONG: [(&str, &str, &str); 14] = [
    ("aggregator.toml", "idle-seconds", "31536001"),
    ("aggregator.toml", "drain-seconds", "86401"),
    ("aggregator.toml", "witness-seconds", "0"),
    ("node.toml", "device", "\"gpu\""),
    ("node.toml", "steps", "0"),
    ("node.toml", "batch-size", "0"),
    ("node.toml", "learning-rate", "0"),
    ("node.toml", "fedprox-mu", "-0.1"),
    ("node.toml", "fedcm-alpha", "0"),
    ("node.toml", "lr-boost", "11"),
    ("node.toml", "cache-budget", "-1"),
    ("prover.toml", "queue", "0"),
    ("witness.toml", "name", "\"a b\""),
    (
        "witness.toml",
        "log-key",
        "[\"zk0.example/my-network+00000000+AAAA\"]",
    ),
];

#[test]
fn a_setting_that_cannot_be_used_is_named_with_its_line() {
    let dir = tempfile::tempdir().unwrap();
    for (name, key, value) in WRONG {
        let text = example(name);
        let mut lines: Vec<_> = text.lines().map(str::to_owned).collect();
        let begin = format!("{key} = ");
        let is_meant = |line: &String| line.trim_start_matches('#').starts_with(&begin);
        let at = lines.iter().position(is_meant).unwrap();
        lines[at] = format!("{begin}{value}");
        let file = dir.path().join(name);
        fs::write(&file, lines.join("\n")).unwrap();
        let &(_, [group, service]) = EXAMPLES.iter().find(|example| example.0 == name).unwrap();
        let arguments = [group, service, "--config", harness::text(&file)];
        let refused = logged(&ends(2, zk0(&arguments)));
        let reports = format!("{}, line {}: ", file.display(), at + 1);
        let flag = format!("'--{key} <");
        assert!(
            refused.contains(&reports) && refused.contains(&flag),
            "{refused}"
        );
    }
}

/// The aggregator's example, with the paths of a network that a test has founded, and every other setting as it is.
fn of_network(network: &LocalNetwork) -> String {
    let text = example("aggregator.toml");
    let paths = [
        ("/var/lib/zk0-aggregator/ledger", network.path("ledger")),
        ("/etc/zk0/log.key", network.path("log.key")),
    ];
    paths.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

#[test]
fn an_aggregator_runs_with_the_example() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let config = network.path("aggregator.toml");
    fs::write(&config, of_network(&network)).unwrap();
    let mut serving = Serving::start(&[
        "aggregator",
        "serve",
        "--config",
        &config,
        "--listen",
        "127.0.0.1:0",
    ]);
    let id = network.genesis().network_id().to_string();
    prints(&[
        "governance",
        "status",
        "--network",
        &id,
        "--aggregator",
        &serving.address,
    ]);
    assert!(serving.terminate().success());

    fs::write(&config, of_network(&network) + "\nmax-conections = 5\n").unwrap();
    let refused = logged(&ends(2, zk0(&["aggregator", "serve", "--config", &config])));
    let line = of_network(&network).lines().count() + 2;
    let reports = format!(
        "{config}, line {line}: max-conections: `zk0 aggregator serve` has no such setting"
    );
    assert!(refused.contains(&reports), "{refused}");
}
