//! The page of the samples: error against run time first, then figures and pictures.

use bokashi_examples::Outcome;
use bokashi_report::{
    Captioned, Cell, Curve, Document, Figure, Figures, PICTURE_HEIGHT, ReportError, Scale, Section,
    Stroke, Table, data_uri, enlarged, picture_of, png,
};

use super::figures::Run;
use crate::about::about;

/// The page of all runs.
pub(super) fn page(runs: &[Run]) -> Result<Document, ReportError> {
    let mut sections = Vec::new();
    for group in runs.chunk_by(|a, b| a.sample.name == b.sample.name) {
        let Run { sample, silhouettes, .. } = &group[0];
        let note = format!("It {}. Silhouettes: {silhouettes}.", sample.about);
        let mut section = Section::new(sample.name, sample.name, note);
        section.push_figures(Figures::new(panels(group), []));
        section.push_table(table(group));
        section.push_pictures("", pictures(group)?);
        sections.push(section);
    }
    let seeds = || runs.iter().map(|run| run.seed);
    let (first, last) = (seeds().min().unwrap_or(0), seeds().max().unwrap_or(0));
    Ok(Document {
        name: "samples",
        heading: "Samples".to_owned(),
        introduction: format!(
            "What people in this field run first, learnt from pictures: seeds {first} to {last}. Each \
             line of a figure is a run."
        ),
        sections,
        files: Vec::new(),
        about: about("bokashi"),
    })
}

/// A figure for each metric that was followed: its value against run time, a line per seed.
fn panels(runs: &[Run]) -> Vec<Figure> {
    let all = || runs.iter().flat_map(|run| run.result.iter().flatten());
    let mut metrics: Vec<&str> = Vec::new();
    for outcome in all().filter(|outcome| outcome.curve.len() > 1) {
        if !metrics.contains(&&*outcome.metric) {
            metrics.push(&outcome.metric);
        }
    }
    let panel = |metric: &str| {
        let curves =
            || all().filter(|outcome| outcome.metric == metric).map(|outcome| &outcome.curve);
        let positive = curves().flatten().all(|&(_, value)| value >= 0.0);
        let is_logarithmic = positive && !metric.contains("PSNR");
        let y = if is_logarithmic { Scale::Logarithmic } else { Scale::Linear };
        let curves = curves().enumerate();
        let curves = curves.map(|(k, curve)| Curve::line(k, Stroke::Solid, curve.iter().copied()));
        Figure::new(metric, (Scale::Seconds, "wall-clock time"), y, curves)
    };
    metrics.into_iter().map(panel).collect()
}

fn table(runs: &[Run]) -> Table {
    let columns = ["seed", "figure", "value", "goal", "steps", "seconds"];
    let mut table = Table::new("", "", &columns.map(|title| (title, "")));
    for run in runs {
        match &run.result {
            Err(error) => {
                table.push(vec![Cell::Count(run.seed as usize), Cell::text(error).flagged()]);
            }
            Ok(outcomes) => outcomes.iter().for_each(|outcome| table.push(row(run, outcome))),
        }
    }
    table
}

fn row(run: &Run, outcome: &Outcome) -> Vec<Cell> {
    let value = Cell::number(outcome.value);
    vec![
        Cell::Count(run.seed as usize),
        Cell::text(&outcome.metric),
        if outcome.passes() { value } else { value.flagged() },
        Cell::text(outcome.goal.to_string()),
        Cell::Count(outcome.steps as usize),
        Cell::Time(outcome.seconds),
    ]
}

/// The pictures of the first run that has any.
fn pictures(runs: &[Run]) -> Result<Vec<Captioned>, ReportError> {
    let all = |run: &Run| run.result.iter().flatten().any(|outcome| !outcome.pictures.is_empty());
    let outcomes = runs.iter().find(|run| all(run)).and_then(|run| run.result.as_ref().ok());
    let pictures = outcomes.into_iter().flatten().flat_map(|outcome| &outcome.pictures);
    let captioned = |(name, image): &(_, _)| {
        let address = data_uri(&png(&enlarged(&picture_of(image)?, PICTURE_HEIGHT))?);
        let [caption, spoken] = [name, name].map(String::from);
        Ok(Captioned { address, caption, spoken, is_linked: false })
    };
    pictures.map(captioned).collect()
}
