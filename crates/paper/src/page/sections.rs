//! The page of a set of fits.

use std::fmt::Write as _;

use bokashi_report::{Document, ReportError, Section, data_uri, escaped};

use super::about::About;
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

/// The whole page, as HTML.
pub(crate) fn page(content: &Content<'_>) -> Result<String, ReportError> {
    let &Content { about, groups, film, failures, trials } = content;
    let of = |experiment| -> Vec<&Group> {
        groups.iter().copied().filter(|group| group.settings.experiment == experiment).collect()
    };
    let experiments = [Experiment::Vertices, Experiment::Sigma, Experiment::Joint]
        .map(|experiment| (panels::heading(experiment), of(experiment)))
        .into_iter()
        .filter(|(_, groups)| !groups.is_empty())
        .collect::<Vec<_>>();

    let mut sections: Vec<(&'static str, &'static str, String)> = Vec::new();
    sections.push(("time", "Error against run time", against_time(&experiments)?));
    sections.push(("speed", "Time per step, and the error it buys", speed(groups)));
    if let Some(film) = film {
        sections.push(("film", "The fit in motion", film_of(groups, film)));
    }
    sections.push(("pictures", "The learnt cube", pictures(&experiments)?));
    sections.push(("steps", "Distance and sigma against step", against_step(&experiments)?));
    if let Some(stuck) = results::stuck(groups)? {
        sections.push(("stuck", "Fits that are stuck", stuck));
    }
    if !failures.is_empty() {
        sections.push(("failures", "Fits that ended in an error", results::failures(failures)));
    }
    sections.push(("fits", "Every fit", every_fit(groups)));
    sections.push(("choices", "Every choice", choices::choices(about, groups)));
    sections.push(("others", "What other choices do", alternatives::html(trials)?));
    sections.retain(|(_, _, body)| !body.is_empty());

    let count: usize = groups.iter().map(|group| group.fits.len()).sum();
    let fits = match count {
        1 => "one fit".to_owned(),
        count => format!("{count} fits, none left out"),
    };
    let sections = sections.into_iter();
    Ok(Document {
        title: "Bokashi: error against run time".to_owned(),
        heading: "A cube, learnt from its blurred pictures".to_owned(),
        introduction: format!(
            "Vertices, colours and the strength of a Gaussian blur, found by gradient descent \
             through a renderer, on a CPU. This report shows {fits}."
        ),
        sections: sections.map(|(id, title, body)| Section { id, title, body }).collect(),
        footer: format!(
            "Made by {}. Beside this page: <code>fits.csv</code>, <code>histories.csv</code>, \
             <code>fit.png</code>, <code>pictures/</code>.",
            escaped(&about.program),
        ),
    }
    .html())
}

type Experiments<'a> = [(&'static str, Vec<&'a Group>)];

fn against_time(experiments: &Experiments<'_>) -> Result<String, ReportError> {
    let mut html = String::new();
    for (heading, groups) in experiments {
        let panels = panels::against_time(groups);
        if !panels.is_empty() {
            let _ = write!(html, "<h3>{heading}</h3>{}", panels::html(groups, &panels)?);
        }
    }
    let groups = || experiments.iter().flat_map(|(_, groups)| groups);
    if !html.is_empty() && groups().any(|group| group.fits.len() > 1) {
        html.push_str(
            "<p class=\"note\">Lines: median over the seeds; bands: from the lower to the upper \
             quartile. Both axes are logarithmic: farther down is better, farther left is \
             sooner.</p>",
        );
    } else if !html.is_empty() {
        html.push_str(
            "<p class=\"note\">One seed per line. A line is the median of the few steps that a \
             point of it stands for, the band around it their least and largest value. Both \
             axes are logarithmic.</p>",
        );
    }
    Ok(html)
}

fn speed(groups: &[&Group]) -> String {
    format!(
        "{}<p class=\"note\">Medians over seeds of medians over steps: forward, backward and \
         optimizer of the learnt image; rendering the target of a new pose is apart, under \
         <i>target image</i>. <i>Paper’s GPU</i>: an NVIDIA RTX 3060 Ti, as printed. <i>Last \
         tenth</i>: the largest error within the last tenth of a run, since Adam at a constant \
         rate can jump back after it has converged. <i>Stuck</i>: ended farther than {} from the \
         cube.</p>",
        results::speed(groups),
        crate::STUCK,
    )
}

fn film_of(groups: &[&Group], film: &Film) -> String {
    let names = film::cast(groups);
    let names: Vec<_> = names.iter().map(|group| escaped(&group.name())).collect();
    format!(
        "<div class=\"film\"><picture><source media=\"(prefers-reduced-motion:reduce)\" \
         srcset=\"{}\"><img alt=\"learnt cubes turn into their targets\" src=\"{}\"></picture>\
         <div><p>Above the learnt cube, below its target, from the first step to the last.</p>\
         <p>From left to right: {}.</p><p class=\"note\">The bar counts steps, evenly in their \
         logarithm; its marks are the powers of ten.</p></div></div>",
        data_uri(&film.still),
        data_uri(&film.moving),
        names.join(", "),
    )
}

fn pictures(experiments: &Experiments<'_>) -> Result<String, ReportError> {
    let mut html = String::new();
    for (heading, groups) in experiments {
        let gallery = gallery::html(groups)?;
        if !gallery.is_empty() {
            let _ = write!(html, "<h3>{heading}</h3>{gallery}");
        }
    }
    if html.is_empty() {
        return Ok(html);
    }
    Ok(format!(
        "<p><i>Seen</i>: the image that a fit compares with its target, pixel by pixel. \
         <i>Cube</i>: the same cube large and sharp, white the learnt wireframe, yellow the true \
         one.</p>{html}"
    ))
}

fn against_step(experiments: &Experiments<'_>) -> Result<String, ReportError> {
    let mut html = String::new();
    for (heading, groups) in experiments {
        let panels = panels::against_step(groups);
        if !panels.is_empty() {
            let _ = write!(html, "<h3>{heading}</h3>{}", panels::html(groups, &panels)?);
        }
    }
    Ok(html)
}

fn every_fit(groups: &[&Group]) -> String {
    format!(
        "<p><i>Own vertex to own place</i>: the vertex error without automorphisms; it is about \
         1 where a fit found the cube with its corners renamed, which no picture can tell.</p>{}",
        results::every_fit(groups)
    )
}
