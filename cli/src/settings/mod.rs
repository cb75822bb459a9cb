//! Settings of the commands that run until they are told to end. Each is a flag, an environment variable and a key of the file of
//! `--config`. Flags come first, then variables, the file, the default.
//!
//! Nothing is listed twice: variables are added to flags, and the file's settings to the arguments, unless they are given already. So one
//! parser checks all values.

mod file;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, ArgAction, ArgMatches, Command, CommandFactory, FromArgMatches};
use file::{FileSetting, SettingsFile};
use std::env;
use std::ffi::OsString;
use std::path::PathBuf;

/// The first word is in the names of their variables.
const SERVICES: [[&str; 2]; 6] = [
    ["aggregator", "serve"],
    ["node", "join"],
    ["prover", "serve"],
    ["witness", "serve"],
    ["ledger", "serve"],
    ["audit", "watch"],
];

const CONFIG: &str = "config";

/// No file has these, but a variable may. The second is of one start of an aggregator.
const NOT_IN_A_FILE: [&str; 2] = [CONFIG, "newest_checkpoint"];

const ORDER: &str = "\
Each setting is a flag, an environment variable and a key of the file that --config names (TOML). A flag counts before the variable, the \
variable before the file, and the file before the default. In the file, a setting has the name of its flag without the dashes, or of its \
argument in small letters.";

/// Parses the process's arguments. If they are wrong, prints why, and exits with code 2.
pub fn parse<T: CommandFactory + FromArgMatches>() -> T {
    parse_from(env::args_os().collect()).unwrap_or_else(|error| error.exit())
}

/// Parses these arguments; the first is the program's name.
///
/// # Errors
/// The arguments, a variable or the file is wrong, or help is asked for.
pub fn parse_from<T: CommandFactory + FromArgMatches>(
    arguments: Vec<OsString>,
) -> Result<T, clap::Error> {
    let mut command = each_service(T::command(), settable);
    let probed = probe(&command).try_get_matches_from(&arguments);
    command.build();
    let (from_variables, from_file) = match &probed {
        Ok(matches) => (
            from_variables(&command, matches),
            from_file(&mut command, matches, &arguments)?,
        ),
        // The parser below reports the error.
        Err(_) => Default::default(),
    };
    let mut command = each_service(command, |service, _| service.mut_args(without_false));
    let mut all = arguments;
    all.splice(from_file.at..from_file.at, from_file.arguments());
    let parsed = command.try_get_matches_from_mut(all);
    let matches = parsed.map_err(|error| {
        let place = about(&error).and_then(|arg| {
            let variable = from_variables.iter().find(|one| one.shown == arg);
            let variable = variable.map(|one| format!("the environment variable {}", one.name));
            variable.or_else(|| from_file.place(arg))
        });
        match place {
            Some(place) => placed(&mut command, &error, &place),
            None => error,
        }
    })?;
    T::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// `change` also gets each service's first word.
fn each_service(mut command: Command, change: impl Fn(Command, &str) -> Command) -> Command {
    for [group, name] in SERVICES {
        let services = command.find_subcommand(group);
        // A light build has fewer.
        if services.is_some_and(|services| services.find_subcommand(name).is_some()) {
            command = command.mut_subcommand(group, |services| {
                services.mut_subcommand(name, |service| change(service, group))
            });
        }
    }
    command
}

/// Adds the variables and `--config`.
fn settable(service: Command, group: &str) -> Command {
    let file = Arg::new(CONFIG)
        .long(CONFIG)
        .value_name("FILE")
        .value_parser(clap::value_parser!(PathBuf))
        .help("Read settings from this TOML file");
    let service = service.arg(file).after_help(ORDER);
    service.mut_args(|arg| {
        let name = format!("ZK0_{group}_{}", key(&arg)).replace('-', "_");
        let name = name.to_uppercase();
        // clap needs static names. There are some dozen.
        let arg = arg.env(&*name.leak()).hide_env_values(true);
        match arg.get_action() {
            ArgAction::Append => arg.value_delimiter(','),
            _ => arg,
        }
    })
}

/// Finds only the service and the settings given. Accepts any value.
fn probe(command: &Command) -> Command {
    let lenient = |arg: Arg| match arg.get_action() {
        ArgAction::Set | ArgAction::Append => arg
            .value_parser(clap::value_parser!(OsString))
            .required(false),
        _ => arg,
    };
    let probe = command.clone().ignore_errors(true).mut_args(lenient);
    each_service(probe, |service, _| service.mut_args(lenient))
}

/// Removes a variable that turns the switch off: clap would count the switch as given, and ask for what it needs.
fn without_false(arg: Arg) -> Arg {
    let reported = arg.get_env().and_then(env::var_os);
    if same(arg.get_action(), &ArgAction::SetTrue)
        && reported.is_some_and(|reported| reported == "false")
    {
        arg.env(None::<&'static str>)
    } else {
        arg
    }
}

struct FromVariable {
    name: String,
    shown: String,
}

/// Settings with a variable and no flag.
fn from_variables(command: &Command, matches: &ArgMatches) -> Vec<FromVariable> {
    let Some(names @ [group, name]) = service_of(matches) else {
        return Vec::new();
    };
    let service = command
        .find_subcommand(group)
        .and_then(|services| services.find_subcommand(name));
    let (Some(service), Some(given)) = (service, given(matches, names)) else {
        return Vec::new();
    };
    let reported = service.get_arguments().filter(|arg| {
        let may_be_set = is_setting(arg) || NOT_IN_A_FILE.contains(&arg.get_id().as_str());
        may_be_set && !is_flag_given(arg, given)
    });
    reported
        .filter_map(|arg| {
            let name = arg.get_env().filter(|name| env::var_os(name).is_some())?;
            Some(FromVariable {
                name: name.to_string_lossy().into_owned(),
                shown: arg.to_string(),
            })
        })
        .collect()
}

fn given<'a>(matches: &'a ArgMatches, [group, name]: [&str; 2]) -> Option<&'a ArgMatches> {
    matches
        .subcommand_matches(group)
        .and_then(|matches| matches.subcommand_matches(name))
}

#[derive(Default)]
struct FromFile {
    /// Before this argument.
    at: usize,
    file: SettingsFile,
    counting: Vec<CountingSettings>,
}

struct CountingSettings {
    line: usize,
    shown: String,
    arguments: Vec<OsString>,
}

fn from_file(
    command: &mut Command,
    matches: &ArgMatches,
    arguments: &[OsString],
) -> Result<FromFile, clap::Error> {
    let Some([group, name]) = service_of(matches) else {
        return Ok(FromFile::default());
    };
    let given = given(matches, [group, name]);
    let path = given.and_then(|given| given.get_one::<OsString>(CONFIG));
    let (Some(given), Some(path)) = (given, path) else {
        return Ok(FromFile::default());
    };
    let service = command
        .find_subcommand_mut(group)
        .and_then(|services| services.find_subcommand_mut(name));
    let Some(service) = service else {
        return Ok(FromFile::default());
    };
    let wrong = |service: &mut Command, why: String| {
        let error = service.error(ErrorKind::InvalidValue, why);
        Err(error.format(service))
    };
    let (file, settings) = match SettingsFile::read(path.as_ref()) {
        Ok(read) => read,
        Err(why) => return wrong(service, why),
    };
    let mut counting = Vec::new();
    for setting in settings {
        let arg = service
            .get_arguments()
            .find(|arg| is_setting(arg) && key(arg) == setting.key);
        let Some(arg) = arg else {
            let known: Vec<_> = service
                .get_arguments()
                .filter(|arg| is_setting(arg))
                .collect();
            let known: Vec<_> = known.into_iter().map(key).collect();
            let why = format!(
                "`zk0 {group} {name}` has no such setting; it has {}",
                known.join(", ")
            );
            let why = file.reports(&setting, &why);
            return wrong(service, why);
        };
        let arguments = match arguments_of(arg, &setting) {
            Ok(arguments) => arguments,
            Err(why) => {
                let why = file.reports(&setting, why);
                return wrong(service, why);
            }
        };
        if !is_given(arg, given) {
            counting.push(CountingSettings {
                line: setting.line,
                shown: arg.to_string(),
                arguments,
            });
        }
    }
    Ok(FromFile {
        at: after_name(arguments, [group, name]),
        file,
        counting,
    })
}

fn service_of(matches: &ArgMatches) -> Option<[&'static str; 2]> {
    let (group, services) = matches.subcommand()?;
    let named = [group, services.subcommand_name()?];
    SERVICES.into_iter().find(|service| *service == named)
}

/// Whether a file may hold it.
fn is_setting(arg: &Arg) -> bool {
    let settable = [ArgAction::Set, ArgAction::Append, ArgAction::SetTrue];
    !NOT_IN_A_FILE.contains(&arg.get_id().as_str())
        && settable.iter().any(|action| same(action, arg.get_action()))
}

fn same(one: &ArgAction, other: &ArgAction) -> bool {
    std::mem::discriminant(one) == std::mem::discriminant(other)
}

fn key(arg: &Arg) -> &str {
    arg.get_long().unwrap_or(arg.get_id().as_str())
}

fn is_given(arg: &Arg, matches: &ArgMatches) -> bool {
    is_flag_given(arg, matches)
        || arg
            .get_env()
            .is_some_and(|name| env::var_os(name).is_some())
}

fn is_flag_given(arg: &Arg, matches: &ArgMatches) -> bool {
    let source = matches.value_source(arg.get_id().as_str());
    source == Some(clap::parser::ValueSource::CommandLine)
}

fn arguments_of(arg: &Arg, setting: &FileSetting) -> Result<Vec<OsString>, &'static str> {
    let reported = |value: String| match arg.get_long() {
        Some(long) => format!("--{long}={value}").into(),
        None => value.into(),
    };
    match arg.get_action() {
        ArgAction::SetTrue => Ok(if setting.flag()? {
            vec![format!("--{}", key(arg)).into()]
        } else {
            Vec::new()
        }),
        ArgAction::Append => Ok(setting.list()?.into_iter().map(reported).collect()),
        _ => Ok(vec![reported(setting.value()?)]),
    }
}

/// Only the log's format comes before the service's names.
fn after_name(arguments: &[OsString], names: [&str; 2]) -> usize {
    let mut at = 1;
    for name in names {
        let rest = arguments.iter().skip(at);
        at += rest.take_while(|argument| *argument != name).count() + 1;
    }
    at.min(arguments.len())
}

impl FromFile {
    fn arguments(&self) -> Vec<OsString> {
        let all = self.counting.iter();
        all.flat_map(|setting| setting.arguments.clone()).collect()
    }

    fn place(&self, arg: &str) -> Option<String> {
        let setting = self.counting.iter().find(|one| one.shown == arg)?;
        Some(format!("{}, line {}", self.file.name(), setting.line))
    }
}

fn about(error: &clap::Error) -> Option<&str> {
    match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(arg)) => Some(arg),
        _ => None,
    }
}

fn placed(command: &mut Command, error: &clap::Error, place: &str) -> clap::Error {
    let text = error.render().to_string();
    let why = text.split("\n\n").next().unwrap_or_default();
    let why = why.strip_prefix("error: ").unwrap_or(why);
    command.error(error.kind(), format!("{place}: {why}"))
}
