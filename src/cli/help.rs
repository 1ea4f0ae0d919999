//! Help of the program: its commands, grouped by task.

/// Tasks with their commands, in the order of the help.
pub(super) const TASKS: &[(&str, &[&str])] = &[
    ("Look", &["list", "inspect", "view", "report", "compare"]),
    ("Run", &["run", "study", "score", "session"]),
    ("Data", &["curate", "generate", "convert", "export"]),
    ("Train", &["train"]),
    ("Publish", &["verify", "reference", "leaderboard"]),
    ("Scale", &["shard", "speed"]),
    ("Shell", &["completions", "man", HELP]),
];

/// Command that clap adds when it parses.
const HELP: &str = "help";

/// Width of the column of commands, characters.
const COMMAND_WIDTH: usize = 11;

/// Returns the template of the program's help. clap has headings for options but not for commands.
pub(super) fn template(command: &clap::Command) -> String {
    let (heading, literal) = (command.get_styles().get_header(), command.get_styles().get_literal());
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n\n".to_owned();
    for (task, names) in TASKS {
        text.push_str(&format!("{heading}{task}:{heading:#}\n"));
        for name in *names {
            let about = command.find_subcommand(name).and_then(clap::Command::get_about);
            let about = about
                .map_or_else(|| "Print this message or the help of a command".into(), ToString::to_string);
            text.push_str(&format!("  {literal}{name:<COMMAND_WIDTH$}{literal:#}  {about}\n"));
        }
        text.push('\n');
    }
    text.push_str(&format!("{heading}Options:{heading:#}\n{{options}}{{after-help}}"));
    text
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{COMMAND_WIDTH, TASKS};
    use crate::cli::command_line;

    #[test]
    fn every_command_belongs_to_a_task() {
        let mut all = command_line();
        all.build();
        let commands: Vec<&str> = all.get_subcommands().map(clap::Command::get_name).collect();
        let grouped: Vec<&str> = TASKS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        assert_eq!(grouped, commands, "the same commands in the same order");
        assert!(commands.iter().all(|name| name.len() <= COMMAND_WIDTH));
    }

    /// Options with the same name in several commands that mean different things there.
    const DIFFERENT: &[&str] = &[
        "case",
        "category",
        "deviations",
        "format",
        "id",
        "keep-rollouts",
        "limit",
        "model",
        "model-weights",
        "models",
        "out",
        "radius",
        "resume",
        "reviews",
        "rollouts",
        "scenarios",
        "set",
        "simulator",
        "svg",
    ];

    #[test]
    fn options_that_commands_share_have_the_same_help() {
        let mut texts = BTreeMap::new();
        collect(&command_line(), "", &mut texts);
        let mut differing = Vec::new();
        for (option, by_text) in &texts {
            if by_text.len() > 1 && !DIFFERENT.contains(&option.as_str()) {
                differing.push(format!("--{option}: {by_text:#?}"));
            }
        }
        assert!(differing.is_empty(), "{}", differing.join("\n"));
    }

    /// Adds the options of a command and of those below it: commands by text by name of the option.
    fn collect(
        command: &clap::Command,
        above: &str,
        texts: &mut BTreeMap<String, BTreeMap<String, Vec<String>>>,
    ) {
        let path = format!("{above} {}", command.get_name());
        for argument in command.get_arguments() {
            let Some(option) = argument.get_long() else { continue };
            let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
            texts.entry(option.to_owned()).or_default().entry(help).or_default().push(path.clone());
        }
        for inner in command.get_subcommands() {
            collect(inner, &path, texts);
        }
    }
}
