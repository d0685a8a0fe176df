//! Other choices than ours where the paper leaves one open, each as fits that show what it does.
//!
//! An alternative differs from ours in one choice. Its fits are in `f64`: rounding then lies below
//! what the choices do to sigma. Experiment 5.2 with targets 1 and 4 is alone with sigma; experiment
//! 5.3 with target 4 has the widest window over a moving image.

use std::fmt;

use bokashi_fit::Mapping;
use bokashi_render_ops::{Border, Kernel, Radius};

use super::settings::{CubeSettings, Experiment, Precision, Preset};

/// What the paper leaves open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Choice {
    /// How far the blur's window reaches.
    Radius,
    /// What the blur sees outside the image.
    Border,
    /// The weights of the blur.
    Kernel,
    /// How sigma stays positive.
    Mapping,
}

impl Choice {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Radius, Self::Border, Self::Kernel, Self::Mapping];
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Radius => "window radius",
            Self::Border => "border",
            Self::Kernel => "kernel",
            Self::Mapping => "sigma stays positive by",
        })
    }
}

/// One way to make the paper's open choices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Alternative {
    /// What is chosen differently; `None`: nothing, these are our choices.
    pub choice: Option<Choice>,
    /// What is chosen, in words; of our choices the radius, which the others are seen against.
    pub name: &'static str,
}

/// Every alternative and ours, which have `kernel`, with the fits that show what it does, of `steps`
/// updates each; fits of one experiment and target follow each other, ours first. A disc has an end:
/// there is no choice of its radius.
pub fn alternatives(steps: u64, kernel: Kernel) -> Vec<(Alternative, CubeSettings)> {
    let shown = [
        (Experiment::Sigma, Preset::Paper, 1.0),
        (Experiment::Sigma, Preset::Paper, 4.0),
        (Experiment::Joint, Preset::Tuned, 4.0),
    ];
    let shown = shown.map(|(experiment, preset, sigma_target)| CubeSettings {
        sigma_target,
        steps,
        kernel,
        precision: Precision::F64,
        ..CubeSettings::new(experiment, preset)
    });
    shown.iter().flat_map(around).collect()
}

/// `ours`, and what differs from it in one choice.
fn around(ours: &CubeSettings) -> Vec<(Alternative, CubeSettings)> {
    let sigma = ours.sigma_target;
    let radius = |radius| CubeSettings { radius: Some(radius), ..ours.clone() };
    let border = |border| CubeSettings { border, ..ours.clone() };
    let kernel = |kernel| CubeSettings { kernel, ..ours.clone() };
    let mapping = |sigma_mapping| CubeSettings { sigma_mapping, ..ours.clone() };
    let stepping_at =
        |reach: f64| radius(Radius::Tolerance(missed(sigma, (reach * sigma) as usize)));
    let three = (3.0 * sigma.max(ours.sigma_start)).ceil() as usize;
    let others = [
        (Choice::Radius, "fixed, 3 times the larger sigma", radius(Radius::Fixed(three))),
        (Choice::Radius, "follows sigma, steps at 3σ*", stepping_at(3.0)),
        (Choice::Radius, "follows sigma, steps at 4σ*", stepping_at(4.0)),
        (Choice::Radius, "follows sigma, steps beside σ*", radius(Radius::Tolerance(THREE_SIGMA))),
        (Choice::Border, "mirror", border(Border::Mirror)),
        (Choice::Border, "clamp", border(Border::Clamp)),
        (Choice::Kernel, "sampled", kernel(Kernel::Sampled)),
        (Choice::Kernel, "unnormalized", kernel(Kernel::Unnormalized)),
        (Choice::Kernel, "disc", kernel(Kernel::Disc)),
        (Choice::Mapping, "exponential", mapping(Mapping::Exp)),
        (Choice::Mapping, "nothing", mapping(Mapping::Identity)),
    ];
    let has_end = ours.kernel == Kernel::Disc;
    let others = others
        .into_iter()
        .filter(|(choice, _, fit)| fit != ours && !(has_end && *choice == Choice::Radius))
        .map(|(choice, name, fit)| (Alternative { choice: Some(choice), name }, fit));
    let name = if has_end { "the whole disc" } else { "fixed, 4 times the larger sigma" };
    let ours = (Alternative { choice: None, name }, ours.clone());
    std::iter::once(ours).chain(others).collect()
}

/// The share of a normal distribution beyond 3 sigma. No target of the paper sits on a step of the
/// window that it gives.
const THREE_SIGMA: f64 = 2.7e-3;

/// The share of an endless window's weight that lies beyond `radius`, per axis. As a tolerance it
/// makes the window step from `radius` to the next one exactly at `sigma`, as `ceil(k sigma)` does
/// where `radius = k sigma`.
fn missed(sigma: f64, radius: usize) -> f64 {
    let weight = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    // Beyond 9.2 sigma nothing is left.
    let end = (9.2 * sigma).ceil() as usize;
    let both_sides = |from: usize| 2.0 * (from..=end).rev().map(weight).sum::<f64>();
    both_sides(radius + 1) / (1.0 + both_sides(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alternative_differs_from_ours_in_its_choice_alone() {
        for kernel in [Kernel::Sampled, Kernel::Unnormalized, Kernel::Discrete, Kernel::Disc] {
            let all = alternatives(7, kernel);
            let mut ours = &all[0].1;
            for (alternative, fit) in &all {
                let undone = match alternative.choice {
                    None => {
                        ours = fit;
                        let found = (fit.steps, fit.kernel, fit.precision);
                        assert_eq!(found, (7, kernel, Precision::F64));
                        continue;
                    }
                    Some(Choice::Radius) => CubeSettings { radius: ours.radius, ..fit.clone() },
                    Some(Choice::Border) => CubeSettings { border: ours.border, ..fit.clone() },
                    Some(Choice::Kernel) => CubeSettings { kernel, ..fit.clone() },
                    Some(Choice::Mapping) => {
                        CubeSettings { sigma_mapping: ours.sigma_mapping, ..fit.clone() }
                    }
                };
                assert_eq!(&undone, ours, "{}", alternative.name);
                assert_ne!(fit, ours, "{}", alternative.name);
            }
            for choice in Choice::ALL {
                let shown = all.iter().any(|(alternative, _)| alternative.choice == Some(choice));
                assert_eq!(shown, (choice, kernel) != (Choice::Radius, Kernel::Disc));
            }
        }
    }

    #[test]
    fn a_window_that_misses_nothing_has_every_weight() {
        assert_eq!(missed(4.0, 37), 0.0);
        // 2 (e^-8 + e^-12.5 + ...) / 2.50662827 for sigma 1 beyond 3 pixels, by hand.
        assert!((missed(1.0, 3) - 2.706_46e-4).abs() < 1e-9, "{:e}", missed(1.0, 3));
    }
}
