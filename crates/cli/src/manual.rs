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
        Some(name) => match all.find_subcommand(name) {
            Some(own) => own.clone(),
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

    #[test]
    fn shells_complete_every_command_and_option() {
        use clap_complete::Shell::{Bash, Fish, Zsh};
        for shell in [Bash, Zsh, Fish] {
            let script = script(shell);
            for own in Request::command().get_subcommands() {
                assert!(script.contains(own.get_name()), "{shell}: {}", own.get_name());
                for option in own.get_arguments().filter_map(clap::Arg::get_long) {
                    assert!(script.contains(option), "{shell}: --{option}");
                }
            }
        }
    }

    #[test]
    fn every_command_has_a_page_that_names_its_options() {
        let whole = page(None).unwrap();
        assert!(whole.contains(".TH bokashi 1") && whole.contains("Exit status:"), "{whole}");
        for own in Request::command().get_subcommands() {
            let name = own.get_name();
            assert!(whole.contains(&format!("bokashi\\-{name}(1)")), "{name}: {whole}");
            let text = page(Some(name)).unwrap();
            assert!(text.contains(&format!(".TH bokashi-{name} 1")), "{text}");
            for option in own.get_arguments().filter_map(clap::Arg::get_long) {
                assert!(text.contains(&option.replace('-', "\\-")), "{name} --{option}: {text}");
            }
        }
        let said = page(Some("fitt")).unwrap_err().to_string();
        assert!(said.starts_with("man needs one of the commands fit, reproduce"), "{said}");
    }
}
