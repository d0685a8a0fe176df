//! Times of other people's blurs on the images that `bokashi-lab bench` times: on standard output as
//! JSON for `bokashi-lab bench --peers FILE`, on standard error as a table.
//!
//! One thread, f32. A blur is forward alone, at the library's truncation.

mod blur;
mod sampling;

use serde::Serialize;

/// One figure; the fields are those of `bokashi_lab::bench::Peer`.
#[derive(Debug, Default, Serialize)]
pub struct Figure {
    pub study: &'static str,
    pub name: &'static str,
    pub scene: Option<&'static str>,
    pub pixels: Option<usize>,
    pub sigma: Option<f64>,
    pub minimum_microseconds: f64,
    pub median_microseconds: f64,
    pub error: Option<f64>,
}

fn main() {
    let figures = blur::figures();
    for figure in &figures {
        let Figure { study, name, pixels, sigma, .. } = figure;
        let what = match (pixels, sigma) {
            (Some(pixels), Some(sigma)) => format!("{pixels} px, sigma {sigma}"),
            _ => String::new(),
        };
        let error = figure.error.map_or(String::new(), |error| format!("error {error:.1e}"));
        eprintln!(
            "{study:<9} {name:<10} {what:<20} minimum {:>12.3} µs, median {:>12.3} µs  {error}",
            figure.minimum_microseconds, figure.median_microseconds
        );
    }
    println!("{}", serde_json::to_string_pretty(&figures).expect("numbers and names"));
}
