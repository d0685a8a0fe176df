//! How long does a step take on a mesh from a file, from all around it, and how good is its gradient?

mod cameras;
mod stepper;

use std::time::Instant;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_render_ops::{Cull, Size};
use bokashi_report::{Cell, Section, Table, quartiles};
use rayon::ThreadPool;

use self::cameras::cameras;
use self::stepper::{Counts, Stepper, View, WAYS};
use super::silhouettes::errors_of;
use crate::bench::effort::{Effort, USUAL};
use crate::bench::mesh_file::MeshFile;
use crate::bench::sampling::{Contestant, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;

/// Along either side of the images, quick and full.
const PIXELS: [&[usize]; 2] = [&[32], &[256, 512, 1024]];
/// Of the images whose gradients are compared with the truth, quick and full.
const TRUTH_PIXELS: [usize; 2] = [32, 256];
/// The truth takes minutes: these cameras alone have one, two of the lower ring and one of the upper.
const TRUTH_CAMERAS: [usize; 3] = [0, 7, 17];
/// Another one of them has its turn only where those before it took fewer seconds.
const TRUTH_SECONDS: f64 = 60.0;
/// A quick run finds the truth of meshes of as many faces.
const QUICK_FACES: usize = 1000;
/// The methods of the study of silhouettes that it is asked of.
const METHODS: [&str; 4] = ["antialias", "antialias, 4x4", "exact, no seams", "exact"];

/// Where vertices are.
const PLACES: [&str; 2] = ["in place", "off"];

/// The median of numbers, one for each camera.
fn median(numbers: impl Iterator<Item = f64>) -> Cell {
    Cell::number(quartiles(numbers)[1])
}

/// The least time of a step, for each way, from one camera.
fn times(
    view: &View<'_>,
    positions: &Tensor<f64>,
    pool: &ThreadPool,
) -> Result<Vec<f64>, FitError> {
    let mut contestants = Vec::new();
    for way in WAYS {
        let mut stepper = Stepper::new(view, way, positions)?;
        contestants.push(Contestant::new(pool, move || stepper.step().map(drop)));
    }
    // Few samples of each: there are as many cameras as would be samples.
    let timings = interleaved(&mut contestants, Effort::Quick, USUAL);
    timings.into_iter().map(|timing| Ok(timing?.minimum)).collect()
}

/// Faces are culled where the surface is closed: then no back face is seen.
fn cull(file: &MeshFile) -> Cull {
    if file.mesh.adjacency().boundary_edges() == 0 { Cull::Back } else { Cull::None }
}

/// Everything of one mesh at one size, vertices in place or off: rows of both tables.
fn measure(
    bench: &Bench,
    file: &MeshFile,
    pixels: usize,
    place_index: usize,
    [costs, counts]: [&mut Table; 2],
) -> Result<(), FitError> {
    let all = cameras();
    let cameras = &all[..bench.effort.choose(2, all.len())];
    // Per camera: per pool and way; per way.
    let (mut seconds, mut counted) = (Vec::new(), Vec::new());
    for &camera in cameras {
        let view = View { file, camera, size: Size::square(pixels), cull: cull(file) };
        let positions = if place_index == 0 { file.positions.clone() } else { view.shifted() };
        let time = |pool: &ThreadPool| times(&view, &positions, pool);
        seconds.push(bench.pools.iter().map(time).collect::<Result<Vec<_>, _>>()?);
        let count = |way| bench.widest().install(|| Stepper::new(&view, way, &positions)?.counts());
        counted.push([count(WAYS[0])?, count(WAYS[1])?, count(WAYS[2])?]);
    }
    let head = [Cell::text(&file.name), Cell::Count(pixels), Cell::text(PLACES[place_index])];
    for (pool_index, pool) in bench.pools.iter().enumerate() {
        let mut row = head.to_vec();
        row.push(Cell::Count(pool.current_num_threads()));
        let seconds_of = |way: usize| seconds.iter().map(move |camera| camera[pool_index][way]);
        row.extend((0..WAYS.len()).map(|way| median(seconds_of(way).map(|seconds| 1e3 * seconds))));
        row.extend(
            (1..WAYS.len()).map(|way| {
                median(seconds_of(way).zip(seconds_of(0)).map(|(own, other)| own / other))
            }),
        );
        let slowest =
            seconds_of(WAYS.len() - 1).map(|seconds| 1e3 * seconds).max_by(f64::total_cmp);
        row.push(Cell::maybe(slowest));
        costs.push(row);
    }
    let mut row = head.to_vec();
    let mut add = |way: usize, what: fn(&Counts) -> usize| {
        let [_, median, _] = quartiles(counted.iter().map(|counts| what(&counts[way]) as f64));
        row.push(Cell::Count(median.round() as usize));
    };
    add(0, |counts| counts.faces);
    add(0, |counts| counts.fragments);
    for way in [1, 2] {
        add(way, |counts| counts.faces);
        add(way, |counts| counts.fragments);
        add(way, |counts| counts.boundary);
        add(way, |counts| counts.pieces);
    }
    counts.push(row);
    Ok(())
}

/// The errors of the gradient from some cameras: a row for each.
fn errors(bench: &Bench, file: &MeshFile, table: &mut Table) -> Result<(), FitError> {
    let pixels = bench.effort.choose(TRUTH_PIXELS[0], TRUTH_PIXELS[1]);
    if bench.effort == Effort::Quick && file.mesh.faces().len() > QUICK_FACES {
        return Ok(());
    }
    let (all, clock) = (cameras(), Instant::now());
    for number in &TRUTH_CAMERAS[..bench.effort.choose(1, TRUTH_CAMERAS.len())] {
        if clock.elapsed().as_secs_f64() > TRUTH_SECONDS {
            break;
        }
        let (camera, size) = (all[*number], Size::square(pixels));
        let view = View { file, camera, size, cull: cull(file) };
        let (target, positions) = (file.positions.clone(), view.shifted());
        let scene = Scene { positions, ..view.scene() };
        let errors = errors_of(bench, scene, target, view.cull, &METHODS)?;
        let mut row = vec![Cell::text(&file.name), Cell::Count(pixels), Cell::Count(*number)];
        row.extend(errors.into_iter().map(|share| Cell::number(100.0 * share)));
        table.push(row);
    }
    Ok(())
}

fn tables() -> [Table; 4] {
    let head = [("mesh", "mesh"), ("pixels", "pixels"), ("vertices", "vertices")];
    let meshes = [
        ("mesh", "mesh"),
        ("faces", "faces"),
        ("vertices", "vertices"),
        ("edges of one face", "boundary_edges"),
        ("back faces", "cull"),
        ("colours", "colours"),
    ];
    let costs = [
        ("threads", "threads"),
        ("antialias, ms", "antialias_milliseconds"),
        ("exact, no seams, ms", "exact_no_seams_milliseconds"),
        ("exact, ms", "exact_milliseconds"),
        ("no seams, times", "exact_no_seams_ratio"),
        ("exact, times", "exact_ratio"),
        ("exact, slowest, ms", "exact_slowest_milliseconds"),
    ];
    let counts = [
        ("faces seen", "antialias_faces"),
        ("fragments", "antialias_fragments"),
        ("faces seen, no seams", "exact_no_seams_faces"),
        ("fragments", "exact_no_seams_fragments"),
        ("boundary pixels", "exact_no_seams_boundary_pixels"),
        ("pieces", "exact_no_seams_pieces"),
        ("faces seen, exact", "exact_faces"),
        ("fragments", "exact_fragments"),
        ("boundary pixels", "exact_boundary_pixels"),
        ("pieces", "exact_pieces"),
    ];
    let errors = [
        ("mesh", "mesh"),
        ("pixels", "pixels"),
        ("camera", "camera"),
        (METHODS[0], "antialias"),
        (METHODS[1], "antialias_4x4"),
        (METHODS[2], "exact_no_seams"),
        (METHODS[3], "exact"),
        ("truth, ±", "truth"),
    ];
    [
        Table::new("meshes", "The meshes", &meshes),
        Table::new(
            "meshes_times",
            "Time of a step, medians over cameras",
            &[&head[..], &costs].concat(),
        ),
        Table::new(
            "meshes_counts",
            "What is drawn, medians over cameras",
            &[&head[..], &counts].concat(),
        ),
        Table::new("meshes_errors", "Relative error of the vertex gradient, %", &errors),
    ]
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let mut study = Section::new(
        "meshes",
        "Meshes from files",
        format!(
            "A mesh in a sphere of radius 1, from {} cameras around it: two rings of twelve, 10 and 40 degrees \
             above its middle. A step is forward, squared error, and gradients of positions and colours, or \
             of positions where a texture is given: it is looked up trilinearly. f32. Back faces are \
             culled where every edge has two faces. Vertices in place, or off as in the step's table: 0.3 \
             px at 256 px, and the same share of other images. A camera's time is the least of three \
             samples; figures are medians over the cameras, and ratios are taken camera by camera. No \
             seams: no edge is one; exact: edges at which colours or texture coordinates bend are. The error \
             of the gradient is that of the study of silhouettes, from the cameras {}, {} and {}, vertices \
             off, with a colour for each vertex; from fewer cameras where the truth takes longer than a minute.",
            cameras().len(),
            TRUTH_CAMERAS[0],
            TRUTH_CAMERAS[1],
            TRUTH_CAMERAS[2],
        ),
    );
    let [mut meshes, mut costs, mut counts, mut truths] = tables();
    let mut files = bench.meshes.clone();
    if files.is_empty() {
        let ball = Scene::sphere("", 16, 9, 8)?;
        files.push(MeshFile::bumpy("bumpy ball", ball.mesh, &ball.positions));
    }
    for file in &files {
        let culled = if cull(file) == Cull::Back { "culled" } else { "drawn" };
        meshes.push(vec![
            Cell::text(&file.name),
            Cell::Count(file.mesh.faces().len()),
            Cell::Count(file.mesh.vertex_count()),
            Cell::Count(file.mesh.adjacency().boundary_edges()),
            Cell::text(culled),
            Cell::text(file.look_name()),
        ]);
        for &pixels in bench.effort.choose(PIXELS[0], PIXELS[1]) {
            for place in 0..PLACES.len() {
                let what = format!("{} at {pixels} px, {}", file.name, PLACES[place]);
                let done = measure(bench, file, pixels, place, [&mut costs, &mut counts]);
                study.noted(&what, done);
            }
        }
        let what = format!("{}, error of the gradient", file.name);
        let done = errors(bench, file, &mut truths);
        study.noted(&what, done);
    }
    study.push_tables([meshes, costs, counts, truths]);
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::mesh_file::Look;

    fn ball() -> MeshFile {
        let ball = Scene::sphere("", 24, 13, 8).unwrap();
        MeshFile::bumpy("ball", ball.mesh, &ball.positions)
    }

    /// The ball under a smooth texture, its coordinates by place.
    fn textured() -> MeshFile {
        let ball = ball();
        let rows = ball.positions.data().as_chunks::<3>().0.iter();
        let rows: Vec<f32> =
            rows.flat_map(|[x, y, _]| [*x, *y].map(|x| 0.4 * x as f32 + 0.5)).collect();
        let coordinates = Tensor::from_flat_fn([ball.mesh.vertex_count(), 2], |k| rows[k]);
        let texels = Tensor::from_flat_fn([32, 32, 3], |k| {
            let [row, column] = [k / 96, k / 3 % 32].map(|texel| texel as f32 / 31.0);
            [row, column, row * column][k % 3]
        });
        MeshFile { look: Look::Texture(coordinates, ball.mesh.clone(), texels), ..ball }
    }

    #[test]
    fn a_step_has_the_gradient_of_its_loss() {
        for file in [ball(), textured()] {
            let (camera, size) = (cameras()[5], Size::square(64));
            let view = View { file: &file, camera, size, cull: cull(&file) };
            assert_eq!(view.cull, Cull::Back);
            let positions = view.shifted();
            for way in &WAYS[1..] {
                // Along its own gradient the loss of a step grows by the square of its length.
                let (_, slope) = Stepper::new(&view, *way, &positions).unwrap().step().unwrap();
                let length: f64 = slope.data().iter().map(|&x| f64::from(x).powi(2)).sum();
                let loss = |by: f64| {
                    let moved = positions.data().iter().zip(slope.data());
                    let moved: Vec<f64> = moved.map(|(x, &g)| x + by * f64::from(g)).collect();
                    let moved = Tensor::from_flat_fn(positions.shape(), |k| moved[k]);
                    f64::from(Stepper::new(&view, *way, &moved).unwrap().step().unwrap().0)
                };
                let by = 1e-3 / length.sqrt();
                let found = (loss(by) - loss(-by)) / (2.0 * by * length);
                assert!((found - 1.0).abs() < 0.1, "{} {way:?}: {found}", file.look_name());
            }
        }
    }

    #[test]
    fn only_exact_coverage_has_pieces_and_seams_have_more() {
        let file = ball();
        let view =
            View { file: &file, camera: cameras()[0], size: Size::square(64), cull: cull(&file) };
        let of = |way| Stepper::new(&view, way, &file.positions).unwrap().counts().unwrap();
        let [antialias, plain, exact] = WAYS.map(of);
        assert!(antialias.pieces == 0 && antialias.boundary == 0 && antialias.fragments > 500);
        assert!(plain.boundary > 0 && plain.pieces >= plain.boundary, "{plain:?}");
        assert!(exact.boundary > plain.boundary && exact.faces >= plain.faces, "{exact:?}");
        assert!(
            plain.faces >= antialias.faces && plain.faces < file.mesh.faces().len(),
            "{plain:?}"
        );
    }
}
