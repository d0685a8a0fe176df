//! How much memory does a step take?
//!
//! The process's largest resident size, before and after, as Linux tells it. The largest size falls
//! only where Linux lets a process reset it, so this study comes first in the process, and its scenes
//! by size. `tests/memory.rs` counts allocated bytes instead, on any system, and bounds them.

use std::fs;

use bokashi_core::Scalar;
use bokashi_fit::FitError;
use bokashi_render_ops::{Cull, Mesh, RasterOptions, Sampling};

use crate::bench::effort::Effort;
use crate::bench::pipeline::{Compared, Learner};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;
use crate::bench::study::Study;
use crate::bench::table::{Cell, Table};

/// A value of this process's status, in bytes.
fn status(name: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kib| 1024.0 * kib)
}

/// The largest size is the present one from now on, where the system allows that.
fn forget_peak() {
    // What it refuses leaves the largest size of an earlier scene, which was smaller.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let mut study = Study::new(
        "memory",
        "Memory of a step",
        "Peak resident size of the process during five steps, less its size before the tape and the \
         parameters were made. The mesh with its adjacency, which all steps share, is apart. Back \
         faces are drawn in the first row alone. Empty where the system does not tell.",
    );
    let mut table = Table::new(
        "memory",
        "Bytes",
        &[
            ("scene", "scene"),
            ("silhouettes", "silhouettes"),
            ("precision", "precision"),
            ("mesh and adjacency, MB", "mesh_megabytes"),
            ("steps, MB", "steps_megabytes"),
            ("steps, bytes per pixel", "bytes_per_pixel"),
        ],
    );
    let usual = match bench.effort {
        Effort::Quick => Scene::sphere("sphere1k", 32, 17, 256)?,
        Effort::Full => Scene::largest()?,
    };
    let large = Scene::sphere_of(1_000, bench.effort.choose(256, 4096))?;
    let options = RasterOptions::new(large.size).cull(Cull::Back);
    let exact = options.sampling(Sampling::Exact);
    measured::<f32>(bench, &mut study, &mut table, &usual, RasterOptions::new(usual.size))?;
    measured::<f32>(bench, &mut study, &mut table, &large, options)?;
    measured::<f32>(bench, &mut study, &mut table, &large, exact)?;
    measured::<f64>(bench, &mut study, &mut table, &large, options)?;
    measured::<f64>(bench, &mut study, &mut table, &large, exact)?;
    study.tables.push(table);
    Ok(study)
}

/// Adds a row of the table: steps on `scene` in `T`.
fn measured<T: Scalar>(
    bench: &Bench,
    study: &mut Study,
    table: &mut Table,
    scene: &Scene,
    options: RasterOptions,
) -> Result<(), FitError> {
    let empty = status("VmRSS");
    // A mesh of its own, without an adjacency yet.
    let scene = Scene {
        mesh: Mesh::new(scene.mesh.faces().to_vec(), scene.mesh.vertex_count())?,
        ..scene.clone()
    };
    scene.mesh.adjacency();
    let before = status("VmRSS");
    forget_peak();
    let mut learner = Learner::<T>::with(&scene, options, Compared::Picture)?;
    let steps = bench.widest().install(|| (0..5).try_for_each(|_| learner.step()));
    if study.noted(&scene.name, steps).is_some() {
        let steps = status("VmHWM").zip(before).map(|(peak, before)| peak - before);
        let mesh = before.zip(empty).map(|(before, empty)| before - empty);
        table.push(vec![
            Cell::text(&scene.name),
            Cell::text(match options.sampling {
                Sampling::Center => "antialias",
                Sampling::Exact | Sampling::Outline => "exact",
            }),
            Cell::text(format!("f{}", 8 * size_of::<T>())),
            Cell::maybe(mesh.map(|bytes| 1e-6 * bytes)),
            Cell::maybe(steps.map(|bytes| 1e-6 * bytes)),
            Cell::maybe(steps.map(|bytes| bytes / scene.size.pixels() as f64)),
        ]);
    }
    Ok(())
}
