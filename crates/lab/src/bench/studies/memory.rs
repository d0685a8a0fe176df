//! How much memory does a step take?
//!
//! The process's largest resident size, before and after, as Linux tells it. The largest size never
//! falls, so this study comes first in the process. `tests/memory.rs` counts allocated bytes
//! instead, on any system, and bounds them.

use std::fs;

use bokashi_fit::FitError;
use bokashi_render_ops::Cull;

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

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let mut study = Study::new(
        "memory",
        "Memory of a step",
        "Peak resident size of the process during five steps (f32, back faces drawn), less its \
         size before the tape and the parameters were made. The mesh with its adjacency, which all \
         steps share, is apart. Empty where the system does not tell.",
    );
    let mut table = Table::new(
        "memory",
        "Bytes",
        &[
            ("scene", "scene"),
            ("mesh and adjacency, MB", "mesh_megabytes"),
            ("steps, MB", "steps_megabytes"),
            ("steps, bytes per pixel", "bytes_per_pixel"),
        ],
    );
    let empty = status("VmRSS");
    let scene = match bench.effort {
        Effort::Quick => Scene::sphere("sphere1k", 32, 17, 256)?,
        Effort::Full => Scene::largest()?,
    };
    scene.mesh.adjacency();
    let before = status("VmRSS");
    let mut learner = Learner::<f32>::new(&scene, Cull::None, Compared::Picture)?;
    let steps = bench.widest().install(|| (0..5).try_for_each(|_| learner.step()));
    if study.noted(&scene.name, steps).is_some() {
        let steps = status("VmHWM").zip(before).map(|(peak, before)| peak - before);
        let mesh = before.zip(empty).map(|(before, empty)| before - empty);
        table.push(vec![
            Cell::text(&scene.name),
            Cell::maybe(mesh.map(|bytes| 1e-6 * bytes)),
            Cell::maybe(steps.map(|bytes| 1e-6 * bytes)),
            Cell::maybe(steps.map(|bytes| bytes / scene.size.pixels() as f64)),
        ]);
    }
    study.tables.push(table);
    Ok(study)
}
