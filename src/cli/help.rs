//! Help of the program: its commands, grouped by task.

/// Tasks with their commands, in the order of the help.
pub(super) const TASKS: &[(&str, &[&str])] = &[
    ("Look", &["list", "inspect", "view", "report", "compare"]),
    ("Run", &["run", "study", "score", "session"]),
    ("Data", &["curate", "generate", "convert", "import", "export"]),
    ("Train", &["train"]),
    ("Publish", &["verify", "reference", "leaderboard"]),
    ("Scale", &["merge"]),
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
    use std::fs;

    use reactsim_test_support::documents;

    use super::{COMMAND_WIDTH, TASKS};
    use crate::cli::command_line::{HELP_WIDTH, command_line};

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
        "columns",
        "deviations",
        "format",
        "future",
        "history",
        "id",
        "limit",
        "maps",
        "model",
        "model-weights",
        "models",
        "out",
        "pose",
        "radius",
        "resume",
        "scenarios",
        "set",
        "simulator",
    ];

    #[test]
    fn options_that_commands_share_have_the_same_help() {
        // Commands by text by name of the option.
        let mut texts: BTreeMap<String, BTreeMap<String, Vec<String>>> = BTreeMap::new();
        for_each_command(&command_line(), "", &mut |path, command| {
            for argument in command.get_arguments() {
                let Some(option) = argument.get_long() else { continue };
                let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
                // clap adds the defaults of some options, and the text of others has them.
                let help = help.split(" [default: ").next().unwrap_or_default().to_owned();
                texts.entry(option.to_owned()).or_default().entry(help).or_default().push(path.to_owned());
            }
        });
        let mut differing = Vec::new();
        for (option, by_text) in &texts {
            if by_text.len() > 1 && !DIFFERENT.contains(&option.as_str()) {
                differing.push(format!("--{option}: {by_text:#?}"));
            }
        }
        assert!(differing.is_empty(), "{}", differing.join("\n"));
    }

    #[test]
    fn texts_below_the_options_wrap_at_any_width() {
        let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ');
        let is_item = |line: &str| line.starts_with(|c: char| c.is_ascii_digit());
        for (place, text) in texts_below_options() {
            let lines: Vec<&str> = text.lines().collect();
            for pair in lines.windows(2) {
                let is_broken = is_prose(pair[0]) && is_prose(pair[1]) && !is_item(pair[1]);
                assert!(!is_broken, "{place}: a paragraph is one line:\n{}\n{}", pair[0], pair[1]);
            }
            // Examples can be copied only if they are not wrapped.
            for line in lines.iter().filter(|line| !is_prose(line)) {
                assert!(line.len() <= HELP_WIDTH, "{place}: longer than {HELP_WIDTH} columns:\n{line}");
            }
        }
    }

    #[test]
    fn commands_in_help_and_documents_are_accepted() {
        let mut texts = texts_below_options();
        for document in documents::all() {
            let text = fs::read_to_string(&document).unwrap();
            for block in text.split("```sh\n").skip(1) {
                texts.push((document.display().to_string(), block.split("```").next().unwrap().to_owned()));
            }
        }
        let commands =
            texts.iter().flat_map(|(place, text)| commands(text).into_iter().map(move |c| (place, c)));
        let rejected: Vec<String> = commands
            .filter_map(|(place, command)| Some(format!("{place}: {command}\n{}", rejection(&command)?)))
            .collect();
        assert!(rejected.is_empty(), "{}", rejected.join("\n"));
        assert!(rejection("reactsim run --modles idm").is_some());
    }

    /// Returns the commands of a text that begin a line, with their continuation lines.
    fn commands(text: &str) -> Vec<String> {
        let text = text.lines().map(str::trim).collect::<Vec<_>>().join("\n").replace("\\\n", "");
        text.lines().filter(|line| line.starts_with("reactsim ")).map(str::to_owned).collect()
    }

    /// Returns the error message with which the program rejects the words of a command, if it does.
    fn rejection(command: &str) -> Option<String> {
        // Examples in help have explanations, two columns apart.
        let command = command.split("  ").next().unwrap_or_default();
        let Some(words) = shlex::split(command) else { return Some("quotes are not closed".to_owned()) };
        let words = words.into_iter().take_while(|word| !matches!(word.as_str(), "|" | ">" | "&&" | "&"));
        let error = command_line().try_get_matches_from(words).err()?;
        // Which backends exist depends on the features of the build.
        (error.use_stderr() && !error.to_string().contains("build it with")).then(|| error.to_string())
    }

    /// Returns the text below the options of every command that has one, with its place.
    fn texts_below_options() -> Vec<(String, String)> {
        let mut texts = Vec::new();
        for_each_command(&command_line(), "", &mut |path, command| {
            texts.extend(command.get_after_help().map(|text| (format!("help of{path}"), text.to_string())));
        });
        texts
    }

    /// Calls a function for a command and all commands below it, with the words that lead to them.
    fn for_each_command(command: &clap::Command, above: &str, visit: &mut impl FnMut(&str, &clap::Command)) {
        let path = format!("{above} {}", command.get_name());
        visit(&path, command);
        for inner in command.get_subcommands() {
            for_each_command(inner, &path, visit);
        }
    }
}
