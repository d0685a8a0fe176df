//! Fits of a lens to pictures of the truth.

use bokashi_catalogue::lens::{
    Frame, LensScene, Named, UNIT, distances, draw, gather, mean_through, named,
};
use bokashi_core::{Tape, Tensor, Var, mean_squared_error};
use bokashi_fit::{Fit, FitError, FitSettings, Mapping, Parameter, Parameters, Schedule, from_fn};
use bokashi_render_ops::ThinLens;
use bokashi_report::{Cell, Table};

use super::measure::Way;
use super::scenes::apart;
use crate::bench::effort::Effort;

/// By how much a start is off.
const OFF: f64 = 1.25;
/// How far away the front fence is.
const FRONT: f64 = 2.0;

/// Updates of a fit.
pub(super) fn steps(effort: Effort) -> u64 {
    effort.choose(2, 200)
}

/// What is learnt of a scene, and how far off the ends are.
struct Learnt {
    /// The aperture, the focus, and the distance of what is [`FRONT`] away, as shares of the truth.
    shares: [f64; 3],
    /// The mean difference of all pixels' circles of confusion, in pixels.
    circles: f64,
}

/// The clip positions of a scene in which what is [`FRONT`] away is `factor` times as far: it looks the same
/// through a pinhole.
fn moved<'t>(scene: &LensScene, clip: Var<'t, f64>, factor: Var<'t, f64>) -> Var<'t, f64> {
    let mask: Vec<f64> = scene.distances().map(|z| f64::from(u8::from(z == FRONT))).collect();
    let mask = Tensor::from_flat_fn([mask.len(), 1], |k| mask[k]);
    clip + clip * clip.tape().constant(&mask) * (factor - 1.0)
}

/// A fit of `scene` with `way` to `target`, from `starts` times the truth; the distance is learnt where that is
/// said.
fn fit(
    way: Way,
    named: &Named,
    target: &Tensor<f64>,
    starts: [f64; 3],
    learns_distance: bool,
    steps: u64,
) -> Result<Learnt, FitError> {
    let Named { scene, numbers, .. } = named;
    let frame = Frame::new(UNIT);
    let parameter = |name: &str, start: f64| {
        let share = Parameter::new(name, Tensor::scalar(start));
        share.mapping(Mapping::Exp).rate(0.03)
    };
    let mut parameters = Parameters::new()
        .with(parameter("aperture", starts[0]))?
        .with(parameter("focus", starts[1]))?;
    if learns_distance {
        parameters = parameters.with(parameter("distance", starts[2]))?;
    }
    let mut pipeline = from_fn(|tape: &Tape<f64>, variables| {
        let mut clip = tape.constant(&scene.clip(frame));
        if learns_distance {
            clip = moved(scene, clip, variables.get("distance")?);
        }
        let aperture = variables.get("aperture")? * numbers[0];
        let lens = ThinLens { aperture, focus: variables.get("focus")? * numbers[1] };
        let image = match way {
            Way::Gather => gather(scene, frame, clip, lens)?,
            _ => draw(scene, frame, clip, lens)?.image,
        };
        Ok(mean_squared_error(image, tape.constant(target))?)
    });
    let schedule = Schedule::Cosine { steps, floor: 0.01 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut fit = Fit::new(parameters, settings)?;
    fit.run(&mut pipeline)?;
    let learnt = |name: &str| Ok::<_, FitError>(fit.parameters().value(name)?.item());
    let distance = if learns_distance { learnt("distance")? } else { 1.0 };
    let shares = [learnt("aperture")?, learnt("focus")?, distance];
    let circle = |[aperture, focus]: [f64; 2], z: f64| aperture * (1.0 - focus / z);
    let found = [0, 1].map(|k| shares[k] * numbers[k]);
    let depths = distances(scene, frame.without_margin())?;
    let differences = depths.data().iter().map(|&z| {
        let own = if z == FRONT { z * distance } else { z };
        (circle(found, own) - circle(*numbers, z)).abs()
    });
    let circles = differences.sum::<f64>() / depths.data().len() as f64;
    Ok(Learnt { shares, circles })
}

/// Rows of fits of a scene from all starts, with both operations.
fn push_rows(
    table: &mut Table,
    named: &Named,
    starts: &[[f64; 3]],
    learns_distance: bool,
    effort: Effort,
) -> Result<(), FitError> {
    let frame = Frame::new(UNIT).without_margin();
    let points = effort.choose(8, 256);
    let target = mean_through(&named.scene, frame, named.numbers, points, 1.0)?;
    for &from in &starts[..effort.choose(1, starts.len())] {
        let mut row = vec![Cell::text(&named.name)];
        let count = 2 + usize::from(learns_distance);
        let off = |share: f64| Cell::number(100.0 * (share - 1.0));
        let column = |k: usize, share: f64| if k < count { off(share) } else { Cell::Nothing };
        row.extend((0..3).map(|k| column(k, from[k])));
        for way in [Way::Picture, Way::Gather] {
            let learnt = fit(way, named, &target, from, learns_distance, steps(effort))?;
            row.extend((0..3).map(|k| column(k, learnt.shares[k])));
            row.push(Cell::number(learnt.circles));
        }
        table.push(row);
    }
    Ok(())
}

/// How far off fits start and end.
pub(super) fn table(effort: Effort) -> Result<Table, FitError> {
    let columns = [
        ("scene", "scene"),
        ("K off, %", "start_aperture_percent"),
        ("f off, %", "start_focus_percent"),
        ("z off, %", "start_distance_percent"),
        ("K, %", "lens_picture_aperture_percent"),
        ("f, %", "lens_picture_focus_percent"),
        ("z, %", "lens_picture_distance_percent"),
        ("circles, px", "lens_picture_circles_pixels"),
        ("K, % D", "depth_of_field_aperture_percent"),
        ("f, % D", "depth_of_field_focus_percent"),
        ("z, % D", "depth_of_field_distance_percent"),
        ("circles, px D", "depth_of_field_circles_pixels"),
    ];
    let groups = [("", 1), ("start", 3), ("lens_picture", 4), ("depth_of_field", 4)];
    let title = "Fits to the truth: how far off each number starts and ends";
    let mut table = Table::new("lens_fits", title, &columns).with_groups(&groups);
    let (low, high) = (1.0 / OFF, OFF);
    let both = [[high, low, 1.0], [low, high, 1.0]];
    let all = named();
    let scenes = effort.choose(1, all.len());
    table.push_part("Nothing within half a pixel of the focus");
    for scene in &apart()[..effort.choose(1, apart().len())] {
        push_rows(&mut table, scene, &both, false, effort)?;
    }
    table.push_part("Scenes by name");
    for scene in &all[..scenes] {
        push_rows(&mut table, scene, &both[..1], false, effort)?;
    }
    table.push_part("Two fences, and the distance of the one in front");
    let three = [[high, high, high], [low, low, low]];
    for fences in all.iter().filter(|scene| scene.name == "two fences") {
        push_rows(&mut table, fences, &three, true, effort)?;
    }
    Ok(table)
}
