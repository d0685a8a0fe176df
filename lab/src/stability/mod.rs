//! The grid of extreme cases: a view of the catalogue, whose entries have the cases and the inputs that
//! they refuse.
//!
//! Each runs in `f32` and in `f64`. A case that panics, or does not end, is a failed row.
//!
//! ```
//! let rows = bokashi_lab::stability::grid_of(&[14], |_| std::ops::ControlFlow::Continue(()));
//! assert_eq!((rows.len(), &*rows[0].name), (2, "collinear vertices"));
//! assert!(rows.iter().all(|row| row.pass));
//! ```

mod page;
mod refusals;
mod row;
mod run;
mod table;

pub use page::{FILES, page};
pub use row::Row;
pub use table::{line, summary};

use std::ops::ControlFlow;

use bokashi_catalogue::{ENTRIES, Entry, Extreme, Outcome};

/// What makes two rows, one in each precision.
#[derive(Debug, Clone)]
struct Case {
    number: Option<u32>,
    name: String,
    expected: &'static str,
    run: Run,
}

/// How a case is run.
#[derive(Debug, Clone, Copy)]
enum Run {
    Extreme(Extreme),
    /// All wrong inputs of an entry.
    Refusals(fn() -> Entry),
}

impl Run {
    fn run(self, precision: &str) -> Outcome {
        match (self, precision) {
            (Self::Extreme(case), "f32") => (case.single)(),
            (Self::Extreme(case), _) => (case.double)(),
            (Self::Refusals(entry), "f32") => refusals::in_single(&entry()),
            (Self::Refusals(entry), _) => refusals::in_double(&entry()),
        }
    }
}

/// The cases of all entries by their numbers, then what each entry refuses.
fn cases() -> Vec<Case> {
    let extremes = ENTRIES.iter().flat_map(|entry| entry().extremes().to_vec());
    let extreme = |case: Extreme| Case {
        number: Some(case.number),
        name: case.name.to_owned(),
        expected: case.expected,
        run: Run::Extreme(case),
    };
    let mut cases: Vec<_> = extremes.map(extreme).collect();
    cases.sort_by_key(|case| case.number);
    let refusals = |&entry: &fn() -> Entry| Case {
        number: None,
        name: format!("{}: wrong input", entry().name()),
        expected: "an error",
        run: Run::Refusals(entry),
    };
    let has_refusals = |entry: &&fn() -> Entry| refusals::are_in(&entry());
    cases.extend(ENTRIES.iter().filter(has_refusals).map(refusals));
    cases
}

/// How many rows the whole grid has.
pub fn row_count() -> usize {
    2 * cases().len()
}

/// The whole grid, in order; `on_row` sees each row as it is made, and may end it there.
///
/// Each case runs in a thread of its own, and what is parallel in it in the global thread pool.
pub fn grid(on_row: impl FnMut(&Row) -> ControlFlow<()>) -> Vec<Row> {
    rows(cases(), on_row)
}

/// The rows of the cases with these numbers.
pub fn grid_of(numbers: &[u32], on_row: impl FnMut(&Row) -> ControlFlow<()>) -> Vec<Row> {
    let is_asked = |case: &Case| case.number.is_some_and(|number| numbers.contains(&number));
    rows(cases().into_iter().filter(is_asked).collect(), on_row)
}

fn rows(cases: Vec<Case>, mut on_row: impl FnMut(&Row) -> ControlFlow<()>) -> Vec<Row> {
    let mut rows = Vec::new();
    for case in cases {
        for precision in ["f32", "f64"] {
            let verdict = run::run(move || case.run.run(precision), run::LIMIT);
            let row = Row {
                case: case.number,
                name: case.name.clone(),
                precision,
                expected: case.expected,
                outcome: verdict.outcome,
                pass: verdict.pass,
                error: verdict.error.filter(|error| error.is_finite()),
                bound: verdict.bound,
            };
            let goes_on = on_row(&row);
            rows.push(row);
            if goes_on.is_break() {
                return rows;
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_ends_where_it_is_asked_to() {
        let mut seen = 0;
        let rows = grid_of(&[14, 16], |row| {
            seen += 1;
            match (row.case, row.precision) {
                (Some(14), "f64") => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        });
        assert_eq!((rows.len(), seen), (2, 2));
    }

    #[test]
    fn a_number_is_that_of_one_case_and_none_of_the_list_is_forgotten() {
        let numbers: Vec<u32> = cases().iter().filter_map(|case| case.number).collect();
        assert!(numbers.is_sorted_by(|a, b| a < b));
        let missing: Vec<u32> = (1..=50).filter(|number| !numbers.contains(number)).collect();
        assert_eq!(missing, [2, 3, 5, 41], "those that entries refuse, and no others");
    }
}
