//! The sections of the page.

use bokashi_report::{About, Figures, ReportError, Section, data_uri, escaped};

use super::alternatives::Trial;
use super::digest::Group;
use super::film::Film;
use super::{alternatives, choices, film, gallery, panels, results};
use crate::{CubeSettings, Experiment};

/// What a page shows.
pub(crate) struct Content<'a> {
    pub(crate) about: &'a About,
    pub(crate) groups: &'a [&'a Group],
    pub(crate) film: Option<&'a Film>,
    pub(crate) failures: &'a [(CubeSettings, String)],
    pub(crate) trials: &'a [Trial],
}

/// All sections; those of what was not run show nothing.
pub(crate) fn sections(content: &Content<'_>) -> Result<Vec<Section>, ReportError> {
    let &Content { about, groups, film, failures, trials } = content;
    let groups_of = |experiment| -> Vec<&Group> {
        groups.iter().copied().filter(|group| group.settings.experiment == experiment).collect()
    };
    let experiments = [Experiment::Vertices, Experiment::Sigma, Experiment::Joint].map(groups_of);
    let mut sections = vec![against_time(&experiments), results::speed(groups)];
    sections.extend(film.map(|film| film_of(groups, film)));
    sections.extend([
        pictures(&experiments)?,
        against_step(&experiments),
        results::stuck(groups)?,
        results::failures(failures),
        results::every_fit(groups),
        choices::section(about, groups),
        alternatives::section(trials),
    ]);
    Ok(sections)
}

fn against_time(experiments: &[Vec<&Group>]) -> Section {
    let note = match experiments.iter().flatten().any(|group| group.fits.len() > 1) {
        true => {
            "Lines: median over the seeds; bands: from the lower to the upper quartile. Both axes are \
             logarithmic: farther down is better, farther left is sooner."
        }
        false => {
            "One seed per line. A line is the median of the few steps that a point of it stands for, the \
             band around it their least and largest value. Both axes are logarithmic."
        }
    };
    let mut section = Section::new("time", "Error against run time", note);
    push_all(&mut section, experiments, panels::against_time);
    section
}

fn against_step(experiments: &[Vec<&Group>]) -> Section {
    let mut section = Section::new("steps", "Distance and sigma against step", "");
    push_all(&mut section, experiments, panels::against_step);
    section
}

/// Adds the figures of each experiment.
fn push_all(
    section: &mut Section,
    experiments: &[Vec<&Group>],
    figures: impl Fn(&[&Group]) -> Figures,
) {
    experiments.iter().for_each(|groups| section.push_figures(figures(groups)));
}

fn film_of(groups: &[&Group], film: &Film) -> Section {
    let names: Vec<_> = film::cast(groups).iter().map(|group| escaped(&group.name())).collect();
    let mut section = Section::new("film", "The fit in motion", "");
    section.push_html(format!(
        "<div class=\"film\"><picture><source media=\"(prefers-reduced-motion:reduce)\" \
         srcset=\"{}\"><img alt=\"learnt cubes turn into their targets\" src=\"{}\"></picture>\
         <div><p>Above the learnt cube, below its target, from the first step to the last.</p>\
         <p>From left to right: {}.</p><p class=\"note\">The bar counts steps, evenly in their \
         logarithm; its marks are the powers of ten.</p></div></div>",
        data_uri(&film.still),
        data_uri(&film.moving),
        names.join(", "),
    ));
    section
}

fn pictures(experiments: &[Vec<&Group>]) -> Result<Section, ReportError> {
    let mut section = Section::new("pictures", "The learnt cube", "");
    for groups in experiments.iter().filter(|groups| !groups.is_empty()) {
        let gallery = gallery::html(groups)?;
        if !gallery.is_empty() {
            let heading = panels::heading(groups[0].settings.experiment);
            section.push_html(format!("<h3>{heading}</h3>{gallery}"));
            section.note = "Seen: the image that a fit compares with its target, pixel by pixel. Cube: the \
                            same cube large and sharp, white the learnt wireframe, yellow the true one."
                .to_owned();
        }
    }
    Ok(section)
}
