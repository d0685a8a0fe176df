//! Errors of pictures and of gradients, scene by scene.

use bokashi_catalogue::lens::{Named, UNIT, named};
use bokashi_fit::FitError;
use bokashi_report::{Cell, Column, Table};

use super::measure::{Measured, Truth, Way, measure};
use super::scenes::{RANDOM, others, random};
use crate::bench::effort::Effort;

/// Up to which size a gradient may be off: on the scenes by name, and on all others.
const SIZES: [f64; 2] = [0.15, 0.2];
/// How far off random scenes may be, in percent.
const REACH: f64 = 1.0;

const COLUMNS: [Column; 16] = [
    ("scene", "scene"),
    ("K", "aperture"),
    ("f", "focus"),
    ("noise, %", "noise_percent"),
    ("RMS, %", "lens_picture_rms_percent"),
    ("SSIM", "lens_picture_ssim"),
    ("by K, %", "lens_picture_size_by_aperture_percent"),
    ("off, %", "lens_picture_off_by_aperture_percent"),
    ("by f, %", "lens_picture_size_by_focus_percent"),
    ("off, %", "lens_picture_off_by_focus_percent"),
    ("RMS, % D", "depth_of_field_rms_percent"),
    ("SSIM D", "depth_of_field_ssim"),
    ("by K, % D", "depth_of_field_size_by_aperture_percent"),
    ("off, % D", "depth_of_field_off_by_aperture_percent"),
    ("by f, % D", "depth_of_field_size_by_focus_percent"),
    ("off, % D", "depth_of_field_off_by_focus_percent"),
];

/// Points on each spiral, and those of differences.
pub(super) fn points(effort: Effort) -> [usize; 2] {
    effort.choose([8, 4], [256, 128])
}

/// What a scene is measured by: how far off it may be, and its gradients.
struct Targets {
    rms: f64,
    size: f64,
}

fn cells(measured: &Measured, targets: &Targets) -> Vec<Cell> {
    let flagged = |cell: Cell, is_off: bool| if is_off { cell.flagged() } else { cell };
    let mut cells = vec![
        flagged(Cell::number(measured.rms), measured.rms > targets.rms),
        Cell::number(measured.ssim),
    ];
    for slope in measured.slopes {
        let is_off = (slope.size - 1.0).abs() > targets.size;
        cells.push(flagged(Cell::number(100.0 * slope.size), is_off));
        cells.push(Cell::number(100.0 * slope.off));
    }
    cells
}

/// A table of scenes, and what was measured of both operations on each.
fn tabulate(
    name: &'static str,
    title: &str,
    scenes: Vec<Named>,
    size: f64,
    effort: Effort,
) -> Result<Table, FitError> {
    let groups = [("", 4), ("lens_picture", 6), ("depth_of_field", 6)];
    let mut table = Table::new(name, title, &COLUMNS).with_groups(&groups);
    for Named { name, scene, numbers, reach } in scenes {
        let truth = Truth::new(&scene, UNIT, numbers, points(effort))?;
        let mut row = vec![
            Cell::text(name),
            Cell::number(numbers[0]),
            Cell::number(numbers[1]),
            Cell::number(truth.noise),
        ];
        for way in [Way::Picture(1), Way::Gather] {
            let measured = measure(way, &scene, UNIT, numbers, &truth)?;
            row.extend(cells(&measured, &Targets { rms: reach, size }));
        }
        table.push(row);
    }
    Ok(table)
}

/// The scenes by name, the random ones and those of other kinds.
pub(super) fn tables(effort: Effort) -> Result<[Table; 3], FitError> {
    let count = effort.choose(1, RANDOM);
    let few = |mut scenes: Vec<Named>| {
        scenes.truncate(effort.choose(1, scenes.len()));
        scenes
    };
    let random = (0..count).map(|seed| {
        let (scene, numbers) = random(seed);
        Named { name: format!("random {seed}"), scene, numbers, reach: REACH }
    });
    let [by_name, other] = SIZES;
    Ok([
        tabulate("lens", "Scenes by name", few(named()), by_name, effort)?,
        tabulate("lens_random", "Random scenes", random.collect(), other, effort)?,
        tabulate("lens_others", "Scenes of other kinds", few(others()), other, effort)?,
    ])
}
