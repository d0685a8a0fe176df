//! Which fits a command stands for.

use bokashi_fit::FitError;
use bokashi_paper::{
    Alternative, CubeSettings, Experiment, Kernel, Preset, Silhouettes, alternatives,
};

use crate::arguments::{CubeArguments, CubeRequest};
use crate::failure::Failure;

/// The target sigmas of the paper's experiments 5.2 and 5.3, in pixels.
const SIGMAS: [f64; 4] = [1.0, 1.4, 2.8, 4.0];
/// The resolutions of the paper's experiment 5.1, in pixels.
const RESOLUTIONS: [usize; 3] = [8, 16, 32];

/// A fit to do.
#[derive(Debug, Clone)]
pub(crate) struct Planned {
    pub(crate) settings: CubeSettings,
    /// Set where the fit is there to show what another choice than ours does.
    pub(crate) alternative: Option<Alternative>,
}

/// Every fit that `request` asks for, in the order they are done in.
///
/// # Errors
/// [`Failure::Use`] for a fit that cannot be saved, or cannot go on from where it should.
pub(crate) fn plan(request: &CubeRequest<'_>) -> Result<Vec<Planned>, Failure> {
    let CubeRequest { common, fit, seeds } = *request;
    let new = |experiment, preset| {
        let settings = CubeSettings {
            steps: common.steps(),
            precision: common.precision(),
            ..CubeSettings::new(experiment, preset)
        };
        with_kernel(settings, common.kernel())
    };
    let planned = |settings| Planned { settings, alternative: None };
    if let Some(fit) = fit {
        let settings = resumed(fit)?.unwrap_or_else(|| settings_of(fit));
        let refused = |error: FitError| Failure::Use(error.to_string());
        request.saving().check(&settings).map_err(refused)?;
        return Ok(vec![planned(settings)]);
    }
    let Some(seeds) = seeds else {
        let settings_of_preset = |preset| {
            SIGMAS
                .map(|sigma_target| CubeSettings { sigma_target, ..new(Experiment::Joint, preset) })
        };
        let both = [Preset::Paper, Preset::Tuned].into_iter().flat_map(settings_of_preset);
        return Ok(both.map(planned).collect());
    };
    let others = alternatives(common.steps(), common.kernel()).into_iter();
    let others =
        others.map(|(alternative, settings)| Planned { settings, alternative: Some(alternative) });
    Ok(of_paper(seeds, new).into_iter().map(planned).chain(others).collect())
}

/// `settings` with the blur's `kernel`, where there is a blur.
fn with_kernel(settings: CubeSettings, kernel: Kernel) -> CubeSettings {
    if settings.blurs() { CubeSettings { kernel, ..settings } } else { settings }
}

/// The settings of a new fit.
fn settings_of(fit: &CubeArguments) -> CubeSettings {
    let experiment = fit.experiment.unwrap_or(Experiment::Joint);
    let settings = CubeSettings::new(experiment, fit.preset.unwrap_or(Preset::Paper));
    let settings = with_kernel(settings, fit.common.kernel());
    CubeSettings {
        steps: fit.common.steps(),
        precision: fit.common.precision(),
        resolution: fit.resolution.unwrap_or(32),
        sigma_target: fit.sigma.unwrap_or(settings.sigma_target),
        seed: fit.seed.unwrap_or(0),
        silhouettes: fit.silhouettes.unwrap_or(Silhouettes::Antialias),
        ..settings
    }
}

/// The settings of the saved fit that goes on: what the command line gives has to agree with them, but for the
/// number of steps.
fn resumed(fit: &CubeArguments) -> Result<Option<CubeSettings>, Failure> {
    let Some(path) = &fit.resume else { return Ok(None) };
    let refused = |error: FitError| Failure::Use(format!("--resume {}: {error}", path.display()));
    let saved = CubeSettings::saved_in(path).map_err(refused)?;
    let pairs = [
        ("experiment", saved.experiment.to_string(), words(&fit.experiment)),
        ("preset", saved.preset.to_string(), words(&fit.preset)),
        ("resolution", saved.resolution.to_string(), words(&fit.resolution)),
        ("sigma", saved.sigma_target.to_string(), words(&fit.sigma)),
        ("kernel", saved.kernel.to_string(), words(&fit.common.kernel)),
        ("seed", saved.seed.to_string(), words(&fit.seed)),
        ("silhouettes", saved.silhouettes.to_string(), words(&fit.silhouettes)),
        ("precision", saved.precision.to_string(), words(&fit.common.precision)),
    ];
    for (option, saved, given) in pairs {
        if let Some(given) = given.filter(|given| *given != saved) {
            let rule = format!("--{option} needs to be that of the saved fit, {saved}");
            return Err(Failure::Use(format!("{rule}, got {given}")));
        }
    }
    let steps = fit.common.steps.unwrap_or(saved.steps);
    Ok(Some(CubeSettings { steps, ..saved }))
}

/// An option's value in words, where it is given.
fn words(value: &Option<impl ToString>) -> Option<String> {
    value.as_ref().map(ToString::to_string)
}

/// The paper's experiments for seeds from 0 on, each setting `new` but for what sets it apart.
fn of_paper(seeds: u64, new: impl Fn(Experiment, Preset) -> CubeSettings) -> Vec<CubeSettings> {
    let mut all = Vec::new();
    for resolution in RESOLUTIONS {
        let all_three = [Silhouettes::Antialias, Silhouettes::Exact, Silhouettes::Aliased];
        all.extend(all_three.map(|silhouettes| {
            let settings = new(Experiment::Vertices, Preset::Paper);
            CubeSettings { resolution, silhouettes, ..settings }
        }));
    }
    all.push(new(Experiment::Vertices, Preset::Tuned));
    for (experiment, preset) in [
        (Experiment::Sigma, Preset::Paper),
        (Experiment::Joint, Preset::Paper),
        (Experiment::Joint, Preset::Tuned),
    ] {
        let with = |sigma_target| CubeSettings { sigma_target, ..new(experiment, preset) };
        all.extend(SIGMAS.map(with));
    }
    let with = |settings: &CubeSettings, seed| CubeSettings { seed, ..settings.clone() };
    all.iter().flat_map(|settings| (0..seeds).map(move |seed| with(settings, seed))).collect()
}

/// The fits of `bokashi paper reproduce` in f32, as names and as arguments of `bokashi paper fit`. A name ends with
/// the seed. Fits that show other choices are left out: no arguments stand for them.
pub fn fits_of_paper(seeds: u64, steps: u64) -> Vec<(String, Vec<String>)> {
    let new = |experiment, preset| CubeSettings { steps, ..CubeSettings::new(experiment, preset) };
    let line = |fit: CubeSettings| {
        let mut options = vec![
            ("experiment", fit.experiment.to_string()),
            ("preset", fit.preset.to_string()),
            ("resolution", fit.resolution.to_string()),
            ("silhouettes", fit.silhouettes.to_string()),
        ];
        if fit.experiment != Experiment::Vertices {
            options.push(("sigma", fit.sigma_target.to_string()));
        }
        options.push(("seed", fit.seed.to_string()));
        let name: Vec<_> = options.iter().map(|(_, value)| value.as_str()).collect();
        let name = name.join("-");
        options.push(("steps", fit.steps.to_string()));
        let arguments = options.into_iter().flat_map(|(name, value)| [format!("--{name}"), value]);
        (name, arguments.collect())
    };
    of_paper(seeds, new).into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::parse;
    use std::collections::HashSet;

    fn all_planned(line: &str) -> Vec<Planned> {
        let words = std::iter::once("bokashi").chain(line.split_whitespace());
        let request = parse(words).expect("a good command line");
        plan(&request.cube().expect("fits of the cube")).expect("no saved fit")
    }

    /// The experiments, without what shows other choices.
    fn planned(line: &str) -> Vec<CubeSettings> {
        let fits = all_planned(line).into_iter().filter(|fit| fit.alternative.is_none());
        fits.map(|fit| fit.settings).collect()
    }

    #[test]
    fn the_default_is_experiment_5_3_for_four_sigmas_at_the_papers_rates_and_at_tuned_ones() {
        let all = planned("");
        for (fits, preset) in all.chunks(4).zip([Preset::Paper, Preset::Tuned]) {
            assert_eq!(fits.iter().map(|fit| fit.sigma_target).collect::<Vec<_>>(), SIGMAS);
            assert!(fits.iter().all(|fit| fit.preset == preset));
        }
        assert_eq!(all.len(), 8);
        assert!(all.iter().all(|fit| fit.experiment == Experiment::Joint));
    }

    #[test]
    fn a_fit_is_one_fit() {
        for silhouettes in [Silhouettes::Aliased, Silhouettes::Antialias, Silhouettes::Exact] {
            let line = "paper fit --sigma 0.5 --seed 9 --resolution 8 --silhouettes";
            let all = planned(&format!("{line} {silhouettes}"));
            let [fit] = &all[..] else { panic!("one") };
            let found = (fit.silhouettes, fit.sigma_target, fit.seed, fit.resolution);
            assert_eq!(found, (silhouettes, 0.5, 9, 8));
        }
    }

    #[test]
    fn reproducing_covers_every_figure_of_the_paper_and_both_presets() {
        let all = planned("paper reproduce --seeds 2 --steps 3 --precision f64");
        let count =
            |what: &dyn Fn(&CubeSettings) -> bool| all.iter().filter(|fit| what(fit)).count();
        assert_eq!(all.len(), 2 * (9 + 1 + 4 + 4 + 4));
        for silhouettes in [Silhouettes::Aliased, Silhouettes::Exact] {
            let of = |fit: &CubeSettings| fit.silhouettes == silhouettes;
            assert_eq!(count(&of), 2 * 3);
            let papers = |fit: &CubeSettings| {
                (fit.experiment, fit.preset) == (Experiment::Vertices, Preset::Paper)
            };
            assert_eq!(count(&|fit| of(fit) && papers(fit)), 2 * 3);
        }
        assert_eq!(count(&|fit| fit.experiment == Experiment::Vertices && fit.resolution == 8), 6);
        assert_eq!(count(&|fit| fit.preset == Preset::Tuned), 2 * 5);
        assert_eq!(count(&|fit| fit.seed == 1 && fit.steps == 3), 22);
    }

    #[test]
    fn a_kernel_is_that_of_every_fit_with_a_blur() {
        for line in ["--kernel disc", "paper fit --kernel disc", "paper reproduce --kernel disc"] {
            let (blurred, sharp): (Vec<_>, Vec<_>) =
                planned(line).into_iter().partition(CubeSettings::blurs);
            assert!(!blurred.is_empty() && blurred.iter().all(|fit| fit.kernel == Kernel::Disc));
            assert!(sharp.iter().all(|fit| fit.kernel == Kernel::default()), "{line}");
        }
    }

    #[test]
    fn fits_as_arguments_are_those_of_reproducing() {
        let fits = fits_of_paper(2, 7);
        let names: HashSet<_> = fits.iter().map(|(name, _)| name).collect();
        assert_eq!(names.len(), fits.len());
        assert_eq!(fits[1].0, "vertices-paper-8-antialias-1");
        let one = |(_, arguments): &(String, Vec<String>)| {
            planned(&format!("paper fit {}", arguments.join(" "))).remove(0)
        };
        let all: Vec<_> = fits.iter().map(one).collect();
        assert_eq!(all, planned("paper reproduce --seeds 2 --steps 7"));
    }

    #[test]
    fn other_choices_are_shown_once_whatever_the_seeds_and_by_reproducing_alone() {
        let others = |line| {
            let all = all_planned(line).into_iter();
            all.filter(|fit| fit.alternative.is_some()).collect::<Vec<_>>()
        };
        for line in ["paper reproduce --seeds 1 --steps 3", "paper reproduce --seeds 5 --steps 3"] {
            let others = others(line);
            assert_eq!(others.len(), alternatives(3, Kernel::Sampled).len());
            assert!(others.iter().all(|fit| fit.settings.steps == 3 && fit.settings.seed == 0));
        }
        assert!(others("").is_empty() && others("paper fit").is_empty());
    }
}
