//! What shells and `man` read of the command line: completions and manual pages.

use clap::CommandFactory as _;

use crate::arguments::{CompletionsArguments, ManArguments, Request};
use crate::failure::Failure;
use crate::output::print;

const PROGRAM: &str = "bokashi";

/// Prints the script that completes commands and options for a shell.
///
/// # Errors
/// As [`print`].
pub(crate) fn completions(arguments: &CompletionsArguments) -> Result<(), Failure> {
    print(&script(arguments.shell))
}

fn script(shell: clap_complete::Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Request::command(), PROGRAM, &mut script);
    String::from_utf8_lossy(&script).into_owned()
}

/// Prints the manual page of the program, or of one of its commands.
///
/// # Errors
/// As [`print`]; [`Failure::Use`] for a command that is not there.
pub(crate) fn man(arguments: &ManArguments) -> Result<(), Failure> {
    print(&page(arguments.command.as_deref())?)
}

fn page(name: Option<&str>) -> Result<String, Failure> {
    let mut all = Request::command();
    // So that commands have their whole names, `bokashi-fit`, and options of all of them.
    all.build();
    let command = match name {
        None => all,
        // A command of a command is named as its page is: `paper-fit`.
        Some(name) => match name.split('-').try_fold(&all, |all, word| all.find_subcommand(word)) {
            Some(subcommand) => subcommand.clone(),
            None => {
                let names: Vec<_> = all.get_subcommands().map(clap::Command::get_name).collect();
                let rule = format!("man needs one of the commands {}", names.join(", "));
                return Err(Failure::Use(format!("{rule}, and this is {name}")));
            }
        },
    };
    let mut page = Vec::new();
    let written = clap_mangen::Man::new(command).render(&mut page);
    written.map_err(|error| Failure::Work(format!("no manual page: {error}")))?;
    Ok(String::from_utf8_lossy(&page).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All commands, those of commands too, by the names of their pages.
    fn commands() -> Vec<(String, clap::Command)> {
        let mut all = Vec::new();
        let mut open = vec![(String::new(), Request::command())];
        while let Some((name, command)) = open.pop() {
            for subcommand in command.get_subcommands() {
                let name = format!("{name}-{}", subcommand.get_name());
                let name = name.trim_start_matches('-').to_owned();
                open.push((name.clone(), subcommand.clone()));
                all.push((name, subcommand.clone()));
            }
        }
        all
    }

    #[test]
    fn shells_complete_every_command_and_option() {
        use clap_complete::Shell::{Bash, Fish, Zsh};
        for shell in [Bash, Zsh, Fish] {
            let script = script(shell);
            for (_, subcommand) in commands() {
                assert!(
                    script.contains(subcommand.get_name()),
                    "{shell}: {}",
                    subcommand.get_name()
                );
                for option in subcommand.get_arguments().filter_map(clap::Arg::get_long) {
                    assert!(script.contains(option), "{shell}: --{option}");
                }
            }
        }
    }

    #[test]
    fn every_command_has_a_page_that_names_its_options() {
        let whole = page(None).unwrap();
        assert!(whole.contains(".TH bokashi 1") && whole.contains("Exit status:"), "{whole}");
        let commands = commands();
        assert!(commands.iter().any(|(name, _)| name == "paper-reproduce"));
        for (name, subcommand) in commands {
            let above = match name.rsplit_once('-') {
                Some((above, _)) => page(Some(above)).unwrap(),
                None => whole.clone(),
            };
            let escaped = name.replace('-', "\\-");
            assert!(above.contains(&format!("bokashi\\-{escaped}(1)")), "{name}: {above}");
            let text = page(Some(&name)).unwrap();
            assert!(text.contains(&format!(".TH bokashi-{name} 1")), "{text}");
            for option in subcommand.get_arguments().filter_map(clap::Arg::get_long) {
                assert!(text.contains(&option.replace('-', "\\-")), "{name} --{option}: {text}");
            }
        }
        let message = page(Some("fitt")).unwrap_err().to_string();
        assert!(message.starts_with("man needs one of the commands fit, paper"), "{message}");
    }
}
