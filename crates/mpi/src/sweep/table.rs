//! What came out of a sweep: a table for people, and a file for programs.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use bokashi_cli::failure::Failure;
use bokashi_cli::output::say;
use bokashi_report::median;
use serde_json::Value;

use super::ended::Ended;
use super::fits::Fit;

/// The numbers of a fit's JSON that tables have, where it has them.
const NUMBERS: [&str; 5] =
    ["steps", "loss_final", "psnr_held_out", "vertex_error_final", "sigma_final"];

/// One fit: its number of each kind, where it has one.
struct Row<'a> {
    name: &'a str,
    ended: &'a Ended,
    numbers: [Option<Value>; NUMBERS.len()],
}

impl<'a> Row<'a> {
    fn read(fits: &'a [Fit], ended: &'a Ended, out: &Path) -> Self {
        let name = &fits[ended.fit].name;
        let text = fs::read_to_string(out.join(name).join("fit.json")).unwrap_or_default();
        // A file that an earlier fit left says nothing of one that failed.
        let json: Value = match ended.failure {
            None => serde_json::from_str(&text).unwrap_or_default(),
            Some(_) => Value::Null,
        };
        let number = |key| json.get(key).filter(|value| value.is_number()).cloned();
        Self { name, ended, numbers: NUMBERS.map(number) }
    }

    /// The name without a number at its end: fits that have it in common are seeds of one setting.
    fn setting(&self) -> &str {
        match self.name.rsplit_once('-') {
            Some((setting, seed)) if seed.parse::<u64>().is_ok() => setting,
            _ => self.name,
        }
    }

    /// What was said in one line, where the fit failed.
    fn failure(&self) -> Option<String> {
        let message = self.ended.failure.as_deref()?;
        Some(message.split_whitespace().collect::<Vec<_>>().join(" "))
    }

    fn csv(&self) -> String {
        let plain = |value: &Option<Value>| value.as_ref().map_or(String::new(), Value::to_string);
        let numbers: Vec<_> = self.numbers.iter().map(plain).collect();
        let Ended { rank, seconds, .. } = self.ended;
        let message = self.failure().unwrap_or_default().replace('"', "\"\"");
        format!("{},{rank},{seconds:.3},{},\"{message}\"\n", self.name, numbers.join(","))
    }

    fn line(&self) -> String {
        let numbers = self.numbers.each_ref().map(|value| value.as_ref().and_then(Value::as_f64));
        let shown = match self.failure() {
            None => shown(numbers),
            Some(message) => format!("failed: {message}"),
        };
        let Ended { rank, seconds, .. } = self.ended;
        format!("{:<36}  rank {rank:<3} {seconds:>8.1} s  {shown}\n", self.name)
    }
}

/// The numbers that there are, each with its name.
fn shown(numbers: [Option<f64>; NUMBERS.len()]) -> String {
    let shown = NUMBERS.iter().zip(numbers).filter_map(|(key, number)| {
        let number = number?;
        let is_count = *key == "steps" && number.fract() == 0.0;
        Some(if is_count { format!("{key} {number}") } else { format!("{key} {number:.3e}") })
    });
    shown.collect::<Vec<_>>().join("  ")
}

/// Medians over the seeds of each setting that has several; those that failed do not count.
fn medians(rows: &[Row<'_>]) -> String {
    let mut text = String::new();
    let mut settings = Vec::<(&str, Vec<&Row<'_>>)>::new();
    for row in rows {
        match settings.iter_mut().find(|(setting, _)| *setting == row.setting()) {
            Some((_, seeds)) => seeds.push(row),
            None => settings.push((row.setting(), vec![row])),
        }
    }
    for (setting, seeds) in settings.into_iter().filter(|(_, seeds)| seeds.len() > 1) {
        let done: Vec<_> = seeds.iter().filter(|row| row.ended.failure.is_none()).collect();
        let column = |index: usize| {
            let numbers = done.iter().filter_map(|row| row.numbers[index].as_ref()?.as_f64());
            median(numbers)
        };
        let seconds = median(done.iter().map(|row| row.ended.seconds));
        let _ = writeln!(
            text,
            "{:<36}  {:>3} of {:<3} {:>8.1} s  {}",
            setting,
            done.len(),
            seeds.len(),
            seconds.unwrap_or(f64::NAN),
            shown(std::array::from_fn(column))
        );
    }
    match text.is_empty() {
        true => text,
        false => format!("\nMedians over seeds:\n{text}"),
    }
}

/// Writes `sweep.csv` to the folder `out`, and tables to standard output.
pub(super) fn write(fits: &[Fit], ended: &[Ended], out: &Path) -> Result<(), Failure> {
    let rows: Vec<_> = ended.iter().map(|ended| Row::read(fits, ended, out)).collect();
    let heading = format!("name,rank,seconds,{},failure\n", NUMBERS.join(","));
    let csv: String = std::iter::once(heading).chain(rows.iter().map(Row::csv)).collect();
    let file = out.join("sweep.csv");
    fs::write(&file, csv)
        .map_err(|error| Failure::Work(format!("{} not written: {error}", file.display())))?;
    let lines: String = rows.iter().map(Row::line).collect();
    say(&format!("{lines}{}Table: {}\n", medians(&rows), file.display()))
}
