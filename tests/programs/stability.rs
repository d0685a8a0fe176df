//! Every extreme case has its defined result or its error, in both precisions.

use std::ops::ControlFlow;

use bokashi_lab::stability::{grid, line, row_count};

#[test]
fn every_row_of_the_grid_passes() {
    let rows = grid(|_| ControlFlow::Continue(()));
    assert_eq!(rows.len(), row_count());
    let failed: Vec<_> = rows.iter().filter(|row| !row.pass).map(line).collect();
    assert!(failed.is_empty(), "{} rows failed:\n{}", failed.len(), failed.join("\n"));
    // To the bit, and so without times: the grid is kept as JSON.
    assert_eq!(grid(|_| ControlFlow::Continue(())), rows, "another run says something else");
}

#[test]
fn a_row_as_json_has_exactly_the_eight_keys_and_numbers_or_nulls() {
    let rows = bokashi_lab::stability::grid_of(&[2, 21], |_| ControlFlow::Continue(()));
    let json = serde_json::to_value(&rows).unwrap();
    let rows = json.as_array().unwrap();
    assert_eq!(rows.len(), 4);
    let keys = ["bound", "case", "error", "expected", "name", "outcome", "pass", "precision"];
    for row in rows {
        let row = row.as_object().unwrap();
        let mut found: Vec<_> = row.keys().map(String::as_str).collect();
        found.sort_unstable();
        assert_eq!(found, keys);
        let has_numbers = row["case"] == 21;
        assert!(row["error"].is_number() == has_numbers && row["error"].is_null() != has_numbers);
        assert!(row["bound"].is_number() == has_numbers && row["bound"].is_null() != has_numbers);
        assert_eq!(row["pass"], true);
    }
}
