//! The samples that people in this field know, from the public interface alone: one file each in
//! `samples/`, under 100 lines. `bokashi samples` runs them.
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
#[path = "samples/focal_stack.rs"]
pub mod focal_stack;
#[path = "samples/material.rs"]
pub mod material;
#[path = "samples/pose.rs"]
pub mod pose;
#[path = "samples/silhouette.rs"]
pub mod silhouette;
#[path = "samples/triangle.rs"]
pub mod triangle;

pub use bokashi::prelude::Silhouettes;
pub use stage::{Curve, Goal, Outcome, Request};

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
    pub run: fn(&Request) -> Result<Vec<Outcome>, FitError>,
}

/// Names the sample that a file's `run` is: its `SAMPLE`.
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
    };
}

/// All samples, the simplest first.
pub const SAMPLES: [Sample; 11] = [
    triangle::SAMPLE,
    cube::SAMPLE,
    pose::SAMPLE,
    earth::SAMPLE,
    envphong::SAMPLE,
    material::SAMPLE,
    depth_of_field::SAMPLE,
    focal_stack::SAMPLE,
    far_start::SAMPLE,
    silhouette::SAMPLE,
    camera::SAMPLE,
];
