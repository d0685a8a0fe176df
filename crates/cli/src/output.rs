//! Standard output, and JSON in files.

use std::io::{self, ErrorKind, Write as _};
use std::path::Path;

use bokashi_write::write_whole;

use crate::failure::Failure;
use crate::plain::{plain, plain_json};

/// Whether `--json` names standard output.
pub fn is_standard_output(file: &Path) -> bool {
    file == Path::new("-")
}

/// Writes to standard output what a terminal shows as it is: names in it can't steer one.
///
/// # Errors
/// [`Failure::Closed`] where its reader went away; [`Failure::Work`] for a full disk and the like.
pub fn say(text: &str) -> Result<(), Failure> {
    print(&plain(text))
}

/// Writes to standard output what the program has made whole, without a name of others in it.
///
/// # Errors
/// As [`say`].
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let mut output = io::stdout().lock();
    let written = output.write_all(text.as_bytes()).and_then(|()| output.flush());
    written.map_err(|error| unwritten("standard output", &error))
}

/// Writes a line of JSON to where `--json` says.
///
/// # Errors
/// As [`say`]; [`Failure::Work`] where the file cannot be written.
pub fn say_json(file: &Path, json: &str) -> Result<(), Failure> {
    let line = format!("{}\n", plain_json(json));
    if is_standard_output(file) {
        return print(&line);
    }
    let failed = |error| unwritten(&file.display().to_string(), &error);
    write_whole(file, line.as_bytes()).map_err(failed)
}

fn unwritten(what: &str, error: &io::Error) -> Failure {
    match error.kind() {
        ErrorKind::BrokenPipe => Failure::Closed,
        _ => Failure::Work(format!("{what} not written: {error}")),
    }
}
