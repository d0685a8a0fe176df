//! The samples that people in this field know, from the public interface alone: one file each in
//! `samples/`, under 100 lines. Each is an example of its own, and `bokashi samples` runs them all.
//!
//! `stage/` has what they share: meshes, textures of our own, random numbers, figures of merit, a fit that is
//! watched; and, for `material`, what of the pipeline does not change: fragments and lights.

// Each sample names this library as any program would.
extern crate self as bokashi_examples;

pub mod stage;

#[path = "samples/camera.rs"]
pub mod camera;
#[path = "samples/cube.rs"]
pub mod cube;
#[path = "samples/depth_of_field.rs"]
pub mod depth_of_field;
#[path = "samples/earth.rs"]
pub mod earth;
#[path = "samples/envphong.rs"]
pub mod envphong;
#[path = "samples/far_start.rs"]
pub mod far_start;
#[path = "samples/material.rs"]
pub mod material;
#[path = "samples/pose.rs"]
pub mod pose;
#[path = "samples/silhouette.rs"]
pub mod silhouette;
#[path = "samples/triangle.rs"]
pub mod triangle;

pub use stage::{Asked, Curve, Found, Goal, Silhouettes};

use bokashi::prelude::FitError;

/// A sample: what it is called, what it learns, and how.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Its name on a command line.
    pub name: &'static str,
    /// What it learns, in a sentence.
    pub about: &'static str,
    /// How silhouettes look where nobody asks for a look.
    pub silhouettes: Silhouettes,
    /// Runs it.
    pub run: fn(&Asked) -> Result<Vec<Found>, FitError>,
}

/// Names the sample that a file's `run` is: its `SAMPLE`, and the `main` that runs it as a program.
/// Silhouettes are antialiased, unless a third word names another look.
#[macro_export]
macro_rules! sample {
    ($name:literal, $about:literal) => {
        $crate::sample!($name, $about, Antialias);
    };
    ($name:literal, $about:literal, $silhouettes:ident) => {
        /// This sample.
        pub const SAMPLE: $crate::Sample = $crate::Sample {
            name: $name,
            about: $about,
            silhouettes: $crate::Silhouettes::$silhouettes,
            run,
        };

        /// Runs it as a program.
        pub fn main() -> Result<(), bokashi::prelude::FitError> {
            $crate::main(&SAMPLE)
        }
    };
}

/// All samples, the simplest first.
pub const SAMPLES: [Sample; 10] = [
    triangle::SAMPLE,
    cube::SAMPLE,
    pose::SAMPLE,
    earth::SAMPLE,
    envphong::SAMPLE,
    material::SAMPLE,
    depth_of_field::SAMPLE,
    far_start::SAMPLE,
    silhouette::SAMPLE,
    camera::SAMPLE,
];

/// Runs one sample as a program: `[SEED [STEPS [SILHOUETTES]]]`. By default that is seed 0, as many steps
/// as the sample needs, and silhouettes as it wants them.
///
/// # Errors
/// Whatever the sample runs into; [`FitError::Setting`] for an argument that is none.
pub fn main(sample: &Sample) -> Result<(), FitError> {
    let mut words = std::env::args().skip(1);
    let mut number = || {
        let rule = "a seed and a number of steps, both whole";
        let refused = |word: &String| FitError::setting("the command line", rule, word);
        words.next().map(|word| word.parse::<u64>().map_err(|_| refused(&word))).transpose()
    };
    let (seed, most_steps) = (number()?.unwrap_or(0), number()?);
    let silhouettes = words.next().map(|word| word.parse()).transpose()?;
    let silhouettes = silhouettes.unwrap_or(sample.silhouettes);
    for found in (sample.run)(&Asked { seed, silhouettes, most_steps })? {
        println!("{found}");
    }
    Ok(())
}
