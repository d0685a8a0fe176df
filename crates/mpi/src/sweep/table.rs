//! What came out of a sweep: a table for people, and a file for programs.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use bokashi_cli::failure::Failure;
use bokashi_cli::output::say;
use serde_json::Value;

use super::ended::Ended;
use super::fits::Fit;

/// The numbers of a fit's JSON that tables have, where it has them.
const NUMBERS: [&str; 5] =
    ["steps", "loss_final", "psnr_held_out", "vertex_error_final", "sigma_final"];

/// Writes `sweep.csv` to the folder `out`, and a table to standard output.
pub(super) fn write(fits: &[Fit], ended: &[Ended], out: &Path) -> Result<(), Failure> {
    let mut csv = format!("name,rank,seconds,{},failure\n", NUMBERS.join(","));
    let mut table = String::new();
    for Ended { fit, rank, seconds, failure } in ended {
        let name = &fits[*fit].name;
        let text = fs::read_to_string(out.join(name).join("fit.json")).unwrap_or_default();
        // A file that an earlier fit left says nothing of one that failed.
        let json: Value = match failure {
            None => serde_json::from_str(&text).unwrap_or_default(),
            Some(_) => Value::Null,
        };
        let numbers = NUMBERS.map(|key| json.get(key).filter(|value| value.is_number()));
        let plain = numbers.map(|value| value.map_or(String::new(), Value::to_string));
        let said = failure.as_deref().unwrap_or_default();
        let line = said.split_whitespace().collect::<Vec<_>>().join(" ");
        let quoted = line.replace('"', "\"\"");
        let _ = writeln!(csv, "{name},{rank},{seconds:.3},{},\"{quoted}\"", plain.join(","));
        let shown = NUMBERS.iter().zip(numbers).filter_map(|(key, value)| {
            let value = value?;
            let text = match value.as_u64() {
                Some(whole) => whole.to_string(),
                None => format!("{:.3e}", value.as_f64()?),
            };
            Some(format!("{key} {text}"))
        });
        let shown = match failure {
            None => shown.collect::<Vec<_>>().join("  "),
            Some(_) => format!("failed: {line}"),
        };
        let _ = writeln!(table, "{name:<36}  rank {rank:<3} {seconds:>8.1} s  {shown}");
    }
    let file = out.join("sweep.csv");
    fs::write(&file, csv)
        .map_err(|error| Failure::Work(format!("{} not written: {error}", file.display())))?;
    say(&format!("{table}Table: {}\n", file.display()))
}
