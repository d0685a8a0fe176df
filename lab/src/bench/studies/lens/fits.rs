//! Fits of a lens to pictures of the truth, from many starts.

use std::ops::RangeInclusive;

use bokashi_catalogue::lens::{Frame, Named, UNIT, distances, draw, gather, mean_through, named};
use bokashi_core::{Tape, Tensor, Var, mean_squared_error};
use bokashi_fit::{Fit, FitError, FitSettings, Mapping, Parameter, Parameters, Schedule, from_fn};
use bokashi_render_ops::ThinLens;
use bokashi_report::{Cell, Column, Table};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::measure::Way;
use super::scenes::apart;
use crate::bench::effort::Effort;

/// By how much each number of a start is off, times or divided.
const OFF: RangeInclusive<f64> = 1.2..=1.3;

/// Which vertices, by index and distance, lie on the surface in front.
type InFront = fn(usize, f64) -> bool;
/// The surfaces in front whose distance is learnt, by how the names of their scenes begin or end. Of two planes a
/// picture shows two circles, and these do not tell three numbers.
const FRONTS: [(&str, InFront); 6] = [
    ("slanted board", |vertex, _| (4..8).contains(&vertex)),
    ("two fences", |_, distance| distance == 2.0),
    ("lamps", |_, distance| distance == 2.0),
    ("five balls", |vertex, _| vertex < 25 * 13),
    ("pane with a hole", |_, distance| distance < 2.5),
    ("thin bars", |_, distance| distance == 2.0),
];

/// Updates of a fit.
pub(super) fn steps(effort: Effort) -> u64 {
    effort.choose(2, 100)
}

/// Starts of a fit.
pub(super) fn seeds(effort: Effort) -> u64 {
    effort.choose(2, 20)
}

/// What a fit starts from: the aperture, the focus and the front's distance, as shares of the truth.
fn start(seed: u64) -> [f64; 3] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    [0; 3].map(|_| {
        let off = rng.random_range(OFF);
        if rng.random_bool(0.5) { off } else { off.recip() }
    })
}

/// How far off the ends of a fit are.
struct Learnt {
    /// The aperture, the focus, and the front's distance, in percent.
    off: [f64; 3],
    /// The mean difference of all pixels' circles of confusion, in pixels.
    circles: f64,
}

/// A scene that fits show.
struct Subject<'a> {
    named: &'a Named,
    target: Tensor<f64>,
    /// Vertices of the surface in front, `[V, 1]`, where its distance is learnt.
    front: Option<Tensor<f64>>,
}

/// Vertices of the surface in front of a scene, `[V, 1]`; `None` where its distance is not learnt.
fn front(Named { name, scene, .. }: &Named) -> Option<Tensor<f64>> {
    let is_of = |part: &str| name.starts_with(part) || name.ends_with(part);
    let (_, is_front) = FRONTS.into_iter().find(|(part, _)| is_of(part))?;
    let distances = scene.distances().enumerate();
    let is_front: Vec<_> = distances.map(|(k, z)| f64::from(u8::from(is_front(k, z)))).collect();
    Some(Tensor::from_flat_fn([is_front.len(), 1], |k| is_front[k]))
}

impl<'a> Subject<'a> {
    fn new(named: &'a Named, front: Option<Tensor<f64>>, points: usize) -> Result<Self, FitError> {
        let frame = Frame::new(UNIT).without_margin();
        let target = mean_through(&named.scene, frame, named.numbers, points, 1.0)?;
        Ok(Self { named, target, front })
    }

    /// Clip positions with the front `factor` times as far away: it looks the same through a pinhole.
    fn moved<'t>(&self, frame: Frame, factor: Var<'t, f64>) -> Var<'t, f64> {
        let tape = factor.tape();
        let clip = tape.constant(&self.named.scene.clip(frame));
        match &self.front {
            Some(front) => clip + clip * tape.constant(front) * (factor - 1.0),
            None => clip,
        }
    }

    /// A fit with `way` from `start`.
    fn fit(&self, way: Way, start: [f64; 3], steps: u64) -> Result<Learnt, FitError> {
        let Named { scene, numbers, .. } = self.named;
        let frame = Frame::new(UNIT);
        let names = ["aperture", "focus", "distance"];
        let names = &names[..2 + usize::from(self.front.is_some())];
        let mut parameters = Parameters::new();
        for (&name, start) in names.iter().zip(start) {
            let share = Parameter::new(name, Tensor::scalar(start));
            parameters = parameters.with(share.mapping(Mapping::Exp).rate(0.03))?;
        }
        let mut pipeline = from_fn(|tape: &Tape<f64>, variables| {
            let factor = match self.front {
                Some(_) => variables.get("distance")?,
                None => tape.constant_scalar(1.0),
            };
            let clip = self.moved(frame, factor);
            let aperture = variables.get("aperture")? * numbers[0];
            let lens = ThinLens { aperture, focus: variables.get("focus")? * numbers[1] };
            let image = match way {
                Way::Gather => gather(scene, frame, clip, lens)?,
                _ => draw(scene, frame, clip, lens)?.image,
            };
            Ok(mean_squared_error(image, tape.constant(&self.target))?)
        });
        let schedule = Schedule::Cosine { steps, floor: 0.01 };
        let mut fit =
            Fit::new(parameters, FitSettings { steps, schedule, ..FitSettings::default() })?;
        fit.run(&mut pipeline)?;
        let mut shares = [1.0; 3];
        for (share, name) in shares.iter_mut().zip(names) {
            *share = fit.parameters().value(name)?.item();
        }
        Ok(Learnt {
            off: shares.map(|share| 100.0 * (share - 1.0).abs()),
            circles: self.circles_off(shares)?,
        })
    }

    /// By how many pixels circles of confusion differ from the truth's, in the mean over all pixels.
    fn circles_off(&self, shares: [f64; 3]) -> Result<f64, FitError> {
        let Named { scene, numbers, .. } = self.named;
        let frame = Frame::new(UNIT).without_margin();
        let circles = |shares: [f64; 3]| -> Result<Vec<f64>, FitError> {
            let tape = Tape::new();
            let clip = self.moved(frame, tape.constant_scalar(shares[2]));
            let [aperture, focus] = [0, 1].map(|k| shares[k] * numbers[k]);
            let distances = distances(scene, frame, clip)?;
            Ok(distances.data().iter().map(|z| aperture * (1.0 - focus / z)).collect())
        };
        let [truth, found] = [circles([1.0; 3])?, circles(shares)?];
        let off = truth.iter().zip(&found).map(|(truth, found)| (truth - found).abs());
        Ok(off.sum::<f64>() / truth.len() as f64)
    }
}

const COLUMNS: [Column; 17] = [
    ("scene", "scene"),
    ("K, %", "lens_picture_aperture_median_percent"),
    ("worst", "lens_picture_aperture_worst_percent"),
    ("f, %", "lens_picture_focus_median_percent"),
    ("worst", "lens_picture_focus_worst_percent"),
    ("z, %", "lens_picture_distance_median_percent"),
    ("worst", "lens_picture_distance_worst_percent"),
    ("circles, px", "lens_picture_circles_median_pixels"),
    ("worst", "lens_picture_circles_worst_pixels"),
    ("K, % D", "depth_of_field_aperture_median_percent"),
    ("worst D", "depth_of_field_aperture_worst_percent"),
    ("f, % D", "depth_of_field_focus_median_percent"),
    ("worst D", "depth_of_field_focus_worst_percent"),
    ("z, % D", "depth_of_field_distance_median_percent"),
    ("worst D", "depth_of_field_distance_worst_percent"),
    ("circles, px D", "depth_of_field_circles_median_pixels"),
    ("worst D", "depth_of_field_circles_worst_pixels"),
];

/// The median and the worst of what all seeds of a scene end at, with both operations.
fn row(named: &Named, front: Option<Tensor<f64>>, effort: Effort) -> Result<Vec<Cell>, FitError> {
    let subject = Subject::new(named, front, effort.choose(8, 256))?;
    let mut row = vec![Cell::text(&named.name)];
    let mut push = |ends: &[f64]| {
        row.push(Cell::median(ends.iter().copied()));
        row.push(Cell::number(ends.iter().copied().fold(0.0, f64::max)));
    };
    for way in [Way::Picture(1), Way::Gather] {
        let fit = |seed: u64| subject.fit(way, start(seed), steps(effort));
        let all = (0..seeds(effort)).map(fit).collect::<Result<Vec<_>, _>>()?;
        let ends = |k: usize| all.iter().map(|one| one.off[k]).collect::<Vec<_>>();
        push(&ends(0));
        push(&ends(1));
        push(&ends(2));
        push(&all.iter().map(|one| one.circles).collect::<Vec<_>>());
    }
    if subject.front.is_none() {
        [5, 6, 13, 14].into_iter().for_each(|column| row[column] = Cell::Nothing);
    }
    Ok(row)
}

/// How far off fits end: of aperture and focus, and of these with a distance.
pub(super) fn table(effort: Effort) -> Result<Table, FitError> {
    let groups = [("", 1), ("lens_picture", 8), ("depth_of_field", 8)];
    let title = "Fits to the truth: how far off each number ends";
    let mut table = Table::new("lens_fits", title, &COLUMNS).with_groups(&groups);
    let mut scenes = apart();
    scenes.extend(named());
    scenes.truncate(effort.choose(2, scenes.len()));
    table.push_part("Aperture and focus");
    for named in &scenes {
        table.push(row(named, None, effort)?);
    }
    table.push_part("And the distance of what is in front");
    for named in &scenes {
        if let Some(front) = front(named) {
            table.push(row(named, Some(front), effort)?);
        }
    }
    Ok(table)
}
