//! How long does a step take, beside what people use today?
//!
//! A step is projection, rasterization, interpolation, antialiasing, squared error, and the gradients
//! with respect to positions and colours. DEODR (its 2-D stage alone, in f64, on one
//! thread) is the peer that is fastest on a CPU.

use bokashi_core::Scalar;
use bokashi_fit::FitError;
use bokashi_render_ops::Cull;
use bokashi_report::{Cell, Curve, Figure, Figures, PALETTE, Scale, Section, Stroke, Table};
use rayon::ThreadPool;

use crate::bench::effort::GENEROUS;
use crate::bench::pipeline::{Compared, Learner, contestant};
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::scenes::{Scene, scenes};
use crate::bench::setting::Bench;

/// DEODR 0.2.3, forward and backward, median milliseconds on a machine of this kind: used where no
/// run on this machine is given.
const DEODR_MILLISECONDS: [(&str, f64); 6] = [
    ("cube@32", 0.074),
    ("cube@256", 1.94),
    ("cube@1024", 37.7),
    ("sphere1k@256", 1.69),
    ("sphere20k@512", 13.4),
    ("sphere80k@1024", 79.5),
];

/// One way to take a step: precision, culling, threads.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    precision: &'static str,
    cull: Cull,
    compared: Compared,
    /// Index of the pool; it has one thread more.
    pool: usize,
}

fn ways(pools: usize) -> Vec<Way> {
    let kinds = [
        ("f32", Cull::Back, Compared::Picture),
        ("f32", Cull::None, Compared::Picture),
        ("f32", Cull::Back, Compared::Image),
        ("f64", Cull::Back, Compared::Picture),
        ("f64", Cull::None, Compared::Picture),
    ];
    let rows_of = |(precision, cull, compared)| {
        (0..pools).map(move |pool| Way { precision, cull, compared, pool })
    };
    kinds.into_iter().flat_map(rows_of).collect()
}

impl Way {
    fn contestant<'a>(
        self,
        scene: &Scene,
        pool: &'a ThreadPool,
    ) -> Result<Contestant<'a>, FitError> {
        fn measure_with<'a, T: Scalar>(
            way: Way,
            scene: &Scene,
            pool: &'a ThreadPool,
        ) -> Result<Contestant<'a>, FitError> {
            Ok(contestant(Learner::<T>::new(scene, way.cull, way.compared)?, pool))
        }
        match self.precision {
            "f32" => measure_with::<f32>(self, scene, pool),
            _ => measure_with::<f64>(self, scene, pool),
        }
    }
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let given = bench.peers_of("scenes").any(|peer| peer.name == "DEODR");
    let source = match given {
        true => "was timed on this machine (minimum; ours are minima too)",
        false => "is as measured on another machine of this kind (median): compare orders only",
    };
    let mut study = Section::new(
        "scenes",
        "A step, beside DEODR",
        format!(
            "A step is projection, rasterization, interpolation, antialiasing, a squared error, \
             and gradients with respect to positions and colours. Only pixels that can differ from \
             the background are antialiased and compared; what the others cost is summed with the \
             reference image, before any step is timed. \"Whole image\" is the same step where all \
             pixels are antialiased and compared. Vertices are shifted within the image plane and \
             keep their depths. Shifts are normally distributed: their standard deviation is 0.3 \
             pixels at 256 px, and the same share of every image. Colours change by 0.05. DEODR \
             0.2.3 {source}. Its figure covers the 2-D stage alone (no projection): whole images \
             in f64, on one thread, with back faces culled. It is shifted alike, but is given the \
             silhouette edges, found once from the unshifted vertices. Ours are found anew in each \
             step. The table has f32 with back faces culled where nothing else is said."
        ),
    );
    let scenes = scenes()?;
    let scenes = &scenes[..bench.effort.choose(1, scenes.len())];
    let ways = ways(bench.pools.len());
    let mut summary = Table::new(
        "scenes",
        "Milliseconds per step, and how many times faster than DEODR",
        &[
            ("scene", "scene"),
            ("faces", "faces"),
            ("DEODR", "deodr_milliseconds"),
            ("1 thread", "f32_1_thread_milliseconds"),
            ("times", "f32_1_thread_times"),
            ("2 threads", "f32_2_threads_milliseconds"),
            ("times", "f32_2_threads_times"),
            ("not culled, 1", "f32_unculled_1_thread_milliseconds"),
            ("2", "f32_unculled_2_threads_milliseconds"),
            ("whole image, 1", "f32_image_1_thread_milliseconds"),
            ("2", "f32_image_2_threads_milliseconds"),
            ("f64, 1", "f64_1_thread_milliseconds"),
            ("2", "f64_2_threads_milliseconds"),
        ],
    );
    let mut all = Table::new(
        "scene_samples",
        "Every way to take a step",
        &[
            ("scene", "scene"),
            ("precision", "precision"),
            ("back faces", "back_faces"),
            ("compared", "compared"),
            ("threads", "threads"),
            ("minimum, ms", "minimum_milliseconds"),
            ("median, ms", "median_milliseconds"),
            ("quartiles apart, %", "spread_percent"),
            ("samples", "samples"),
        ],
    )
    .not_printed();
    // Milliseconds of f32 with back faces culled against pixels, per pool.
    let mut cube = vec![Vec::new(); bench.pools.len() + 1];
    for scene in scenes {
        let mut contestants = Vec::new();
        for way in &ways {
            contestants.push(way.contestant(scene, &bench.pools[way.pool])?);
        }
        let timings = interleaved(&mut contestants, bench.effort, GENEROUS);
        let mut minima: Vec<(Way, Timing)> = Vec::new();
        for (way, timing) in ways.iter().zip(timings) {
            let what = format!("{}, {way:?}", scene.name);
            let Some(timing) = study.noted(&what, timing) else { continue };
            minima.push((*way, timing));
            let back = if way.cull == Cull::Back { "culled" } else { "drawn" };
            all.push(vec![
                Cell::text(&scene.name),
                Cell::text(way.precision),
                Cell::text(back),
                Cell::text(if way.compared == Compared::Picture { "picture" } else { "image" }),
                Cell::Count(way.pool + 1),
                timing.cell(1e3 * timing.minimum),
                timing.cell(1e3 * timing.median),
                timing.cell(100.0 * timing.spread()),
                Cell::Count(timing.samples),
            ]);
        }
        let deodr = deodr(bench, &scene.name);
        let measured = |precision, cull, compared, pool| {
            let wanted = Way { precision, cull, compared, pool };
            minima.iter().find(|(way, _)| *way == wanted).map(|(_, timing)| timing)
        };
        let usual = |pool| measured("f32", Cull::Back, Compared::Picture, pool);
        let cell = |precision, cull, compared, pool| {
            let timing = measured(precision, cull, compared, pool);
            timing.map_or(Cell::Nothing, |timing| timing.cell(1e3 * timing.minimum))
        };
        let times = |pool| {
            let ours = usual(pool);
            Cell::maybe(deodr.zip(ours).map(|(deodr, ours)| deodr / (1e3 * ours.minimum)))
        };
        summary.push(vec![
            Cell::text(&scene.name),
            Cell::Count(scene.mesh.faces().len()),
            Cell::maybe(deodr),
            cell("f32", Cull::Back, Compared::Picture, 0),
            times(0),
            cell("f32", Cull::Back, Compared::Picture, 1),
            times(1),
            cell("f32", Cull::None, Compared::Picture, 0),
            cell("f32", Cull::None, Compared::Picture, 1),
            cell("f32", Cull::Back, Compared::Image, 0),
            cell("f32", Cull::Back, Compared::Image, 1),
            cell("f64", Cull::Back, Compared::Picture, 0),
            cell("f64", Cull::Back, Compared::Picture, 1),
        ]);
        if scene.name.starts_with("cube") {
            let mut point = |index: usize, [low, middle, high]: [f64; 3]| {
                cube[index].push([scene.size.width as f64, low, middle, high]);
            };
            for pool in 0..bench.pools.len() {
                if let Some(t) = usual(pool) {
                    point(pool, [t.minimum, t.minimum, t.upper_quartile]);
                }
            }
            if let Some(deodr) = deodr {
                point(bench.pools.len(), [1e-3 * deodr; 3]);
            }
        }
    }
    let names = (0..bench.pools.len()).map(|pool| format!("f32, threads: {}", pool + 1));
    let names: Vec<String> = names.chain(["DEODR".to_owned()]).collect();
    let legend =
        names.iter().enumerate().map(|(index, name)| (name.clone(), PALETTE[index], Stroke::Solid));
    let curves = cube.into_iter().enumerate();
    let curves = curves.map(|(color, points)| Curve::new(color, Stroke::Solid, points).with_dots());
    let title = "The cube: time per step; bands: to the upper quartile";
    let x = (Scale::Counts, "width and height, pixels");
    let panel = Figure::new(title, x, Scale::Seconds, curves);
    study.push_figures(Figures::new([panel], legend));
    study.push_tables([summary, all]);
    Ok(study)
}

/// DEODR's milliseconds on the scene `name`: on this machine where they were measured there.
fn deodr(bench: &Bench, name: &str) -> Option<f64> {
    let mut here = bench.peers_of("scenes").filter(|peer| peer.name == "DEODR");
    let here = here.find(|peer| peer.scene.as_deref() == Some(name));
    let there = || DEODR_MILLISECONDS.iter().find(|(scene, _)| *scene == name).map(|row| row.1);
    match here {
        Some(peer) => Some(1e-3 * peer.minimum_microseconds),
        None => there(),
    }
}
