//! The extreme-case grid: what is put in, what has to come out, what came out.
//!
//! Every case runs in `f32` and in `f64`. Wherever there is an exact answer, the case compares with
//! it. The answer is worked out another way: in whole numbers, by a linear system per pixel, by a
//! double sum over taps, or by hand. The case says how far off it is and how far it may be. A case
//! that panics, or does not end, is a failed row.
//!
//! ```
//! let rows = bokashi_lab::stability::grid_of(&[14], |_| std::ops::ControlFlow::Continue(()));
//! assert_eq!((rows.len(), rows[0].name), (2, "collinear vertices"));
//! assert!(rows.iter().all(|row| row.pass));
//! ```

mod blur;
mod cameras;
mod cases;
mod distances;
mod downsampling;
mod exact;
mod faces;
mod focus;
mod input;
mod layers;
mod lights;
mod losses;
mod oracle;
mod page;
mod pictures;
mod row;
mod run;
mod scene;
mod silhouettes;
mod surfaces;
mod table;
mod tensors;
mod textures;
mod values;
mod vertices;

pub use page::page;
pub use row::Row;
pub use table::{line, summary};

use std::ops::ControlFlow;

use cases::CASES;

/// How many rows the whole grid has.
pub fn row_count() -> usize {
    2 * CASES.len()
}

/// The whole grid, in order; `on_row` sees each row as it is found, and may end it there.
///
/// Each case runs in a thread of its own, and what is parallel in it in the global thread pool.
pub fn grid(on_row: impl FnMut(&Row) -> ControlFlow<()>) -> Vec<Row> {
    let all: Vec<u32> = CASES.iter().map(|case| case.number).collect();
    grid_of(&all, on_row)
}

/// The rows of the cases with these numbers.
pub fn grid_of(numbers: &[u32], mut on_row: impl FnMut(&Row) -> ControlFlow<()>) -> Vec<Row> {
    let mut rows = Vec::new();
    for case in CASES.iter().filter(|case| numbers.contains(&case.number)) {
        for (precision, run) in [("f32", case.single), ("f64", case.double)] {
            let found = run::run(run, run::LIMIT);
            let row = Row {
                case: case.number,
                name: case.name,
                precision,
                expected: case.expected,
                outcome: found.outcome,
                pass: found.pass,
                error: found.error.filter(|error| error.is_finite()),
                bound: found.bound,
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
    fn the_grid_ends_where_it_is_told_to() {
        let mut seen = 0;
        let rows = grid_of(&[14, 16], |row| {
            seen += 1;
            match (row.case, row.precision) {
                (14, "f64") => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        });
        assert_eq!((rows.len(), seen), (2, 2));
    }

    #[test]
    fn every_case_of_the_list_is_there_once_and_in_order() {
        let numbers: Vec<u32> = CASES.iter().map(|case| case.number).collect();
        assert!(numbers.is_sorted_by(|a, b| a < b));
        let missing: Vec<u32> = (1..=50).filter(|number| !numbers.contains(number)).collect();
        assert_eq!(missing, [0_u32; 0], "cases without a row");
    }
}
