//! Tables: every fit, and the thinned histories, as CSV.
//!
//! In the table of fits, numbers are written so that reading them gives the same bits; in that
//! of histories, with five digits. What does not apply, or is not a number, is an empty field.

use std::fmt::Write as _;

use super::digest::{Fit, Quantity};

/// The columns of [`fits`]: the keys of the JSON object, and whether the fit is stuck.
const FIT_COLUMNS: &str = "experiment,preset,resolution,seed,steps,silhouettes,precision,\
    sigma_target,sigma_final,vertex_error_initial,vertex_error_final,vertex_error_plain,\
    vertex_error_tail,color_error_final,loss_initial,loss_final,ms_per_step_median,\
    target_ms_per_step_median,wall_seconds,stuck";

/// One row per fit.
pub(crate) fn fits(fits: &[Fit]) -> String {
    let mut table = format!("{FIT_COLUMNS}\n");
    for fit in fits {
        let outcome = &fit.outcome;
        let numbers = [
            outcome.sigma_target,
            outcome.sigma_final,
            outcome.vertex_error_initial,
            outcome.vertex_error_final,
            outcome.vertex_error_plain,
            outcome.vertex_error_tail,
            outcome.color_error_final,
            Some(outcome.loss_initial),
            Some(outcome.loss_final),
            outcome.ms_per_step_median,
            outcome.target_ms_per_step_median,
            Some(outcome.wall_seconds),
        ];
        table.push_str(&settings(fit));
        for number in numbers {
            let _ = write!(table, ",{}", field(number));
        }
        let _ = writeln!(table, ",{}", fit.is_stuck());
    }
    table
}

/// One row per fit and window of steps: the median of each quantity, and of errors the largest.
pub(crate) fn histories(fits: &[Fit]) -> String {
    let mut table = "experiment,preset,resolution,seed,steps,silhouettes,precision,sigma_target,\
        step,seconds,loss,loss_largest,vertex_error,vertex_error_largest,color_error,\
        color_error_largest,sigma,sigma_error_largest\n"
        .to_owned();
    for fit in fits {
        let head = format!("{},{}", settings(fit), field(fit.outcome.sigma_target));
        for window in &fit.windows {
            let of = |quantity: Quantity| window.values[quantity as usize];
            let _ = write!(table, "{head},{},{:.4e}", window.step, window.seconds);
            for quantity in [Quantity::Loss, Quantity::VertexError, Quantity::ColorError] {
                let [_, median, largest] = of(quantity);
                let _ = write!(table, ",{},{}", digits(median), digits(largest));
            }
            let (sigma, error) = (of(Quantity::Sigma)[1], of(Quantity::SigmaError)[2]);
            let _ = writeln!(table, ",{},{}", digits(sigma), digits(error));
        }
    }
    table
}

/// The columns that name a fit.
fn settings(fit: &Fit) -> String {
    let outcome = &fit.outcome;
    format!(
        "{},{},{},{},{},{},{}",
        outcome.experiment,
        outcome.preset,
        outcome.resolution,
        outcome.seed,
        outcome.steps,
        outcome.silhouettes,
        outcome.precision
    )
}

/// A number, or nothing.
fn field(number: Option<f64>) -> String {
    number
        .filter(|number| number.is_finite())
        .map(|number| format!("{number:e}"))
        .unwrap_or_default()
}

/// Five digits of a number, or nothing.
fn digits(number: f64) -> String {
    if number.is_finite() { format!("{number:.4e}") } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_an_empty_field() {
        assert_eq!([field(None), field(Some(f64::NAN)), digits(f64::NAN)], ["", "", ""]);
        assert_eq!(field(Some(0.1)).parse(), Ok(0.1));
    }
}
