//! What a scene does not need costs nothing, changes no bit, and is named.
//!
//! Each row has two steps that differ in one thing: the first computes it, the second has no need
//! of it. Whatever both give (picture, loss, gradients) must be the same to the bit, and the report
//! of the second step's tape must name what was left out.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use bokashi_core::{Tape, Tensor};
use bokashi_fit::{FitError, squared_error};
use bokashi_render_ops::{
    Background, Blur, Mesh, RasterOptions, Size, antialias, composite, depth, gaussian_blur,
    interpolate, project, rasterize,
};
use bokashi_report::{Document, ReportError, Section, add_page, escaped};
use glam::DVec4;
use serde::{Serialize, Serializer, ser::SerializeStruct as _};

use crate::bench::effort::{Effort, GENEROUS};
use crate::bench::page::write_csv;
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::{Bench, method};
use crate::bench::table::{Cell, FEW_SAMPLES, Table};

/// A row: one thing computed, and left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What the second step has no need of.
    pub row: &'static str,
    /// What both gave, and whether it is the same to the bit.
    pub results: Vec<(&'static str, bool)>,
    /// What the second step's report names as left out and the first one's does not.
    pub left_out: Vec<String>,
    with: Timing,
    without: Timing,
}

impl Row {
    /// The least time of the step that computes it, in microseconds.
    pub fn microseconds_with(&self) -> f64 {
        1e6 * self.with.minimum
    }

    /// The least time of the step that has no need of it, in microseconds.
    pub fn microseconds_without(&self) -> f64 {
        1e6 * self.without.minimum
    }

    /// How the time of the step that has no need of it compares with the other's: equal where the
    /// ranges between their quartiles meet.
    pub fn time_without(&self) -> Ordering {
        self.without.compare(&self.with)
    }

    /// The same in a word, marked where it comes from few samples.
    fn verdict(&self) -> String {
        let word = match self.time_without() {
            Ordering::Less => "faster",
            Ordering::Equal => "equal",
            Ordering::Greater => "SLOWER",
        };
        let is_marked = !(self.with.has_enough_samples() && self.without.has_enough_samples());
        format!("{word}{}", if is_marked { FEW_SAMPLES } else { "" })
    }

    /// Whether all results are the same to the bit.
    pub fn bitwise_equal(&self) -> bool {
        self.results.iter().all(|&(_, same)| same)
    }
}

/// As `{row, microseconds_with, microseconds_without, bitwise_equal}`.
impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Row", 4)?;
        object.serialize_field("row", self.row)?;
        object.serialize_field("microseconds_with", &self.microseconds_with())?;
        object.serialize_field("microseconds_without", &self.microseconds_without())?;
        object.serialize_field("bitwise_equal", &self.bitwise_equal())?;
        object.end()
    }
}

/// A step, and what it asks for.
#[derive(Debug, Clone)]
struct Step {
    scene: Scene,
    learns_positions: bool,
    learns_colors: bool,
    /// The blur; `None`: there is none.
    sigma: Option<f32>,
    learns_sigma: bool,
    /// A background of zeros with a gradient of its own, not the empty one.
    has_background: bool,
    /// The depth has an upstream gradient, of zeros.
    has_depth: bool,
}

/// What a step gives, by name.
type Results = Vec<(&'static str, Tensor<f32>)>;

impl Step {
    /// Positions, colours and sigma are learnt before an empty background.
    fn new(scene: &Scene) -> Self {
        Self {
            scene: scene.clone(),
            learns_positions: true,
            learns_colors: true,
            sigma: Some(1.0),
            learns_sigma: true,
            has_background: false,
            has_depth: false,
        }
    }

    /// The same without a blur.
    fn sharp(scene: &Scene) -> Self {
        Self { sigma: None, learns_sigma: false, ..Self::new(scene) }
    }

    fn learns(&self) -> bool {
        self.learns_positions || self.learns_colors || self.learns_sigma
    }

    /// The tensors that the step starts from.
    fn start(&self) -> Start {
        let [height, width] = [self.scene.size.height, self.scene.size.width];
        Start {
            positions: self.scene.positions.cast(),
            colors: self.scene.colors.cast(),
            sigma: Tensor::scalar(self.sigma.unwrap_or_default()),
            background: Tensor::zeros([height, width, 3]),
            target: Tensor::full([height, width, 3], 0.25),
            one: Tensor::scalar(1.0),
            depth_upstream: None,
        }
    }

    /// Takes the step; gives what it found where `look` says so.
    fn take(&self, start: &mut Start, tape: &Tape<f32>, look: bool) -> Result<Results, FitError> {
        let leaf = |learns: bool, tensor: &Tensor<f32>| match learns {
            true => tape.leaf(tensor),
            false => tape.constant(tensor),
        };
        let positions = leaf(self.learns_positions, &start.positions);
        let colors = leaf(self.learns_colors, &start.colors);
        let sigma = leaf(self.learns_sigma, &start.sigma);
        let clip = project(positions, &self.scene.camera, None)?;
        let options = RasterOptions::from(self.scene.size);
        let fragments = rasterize(clip, &self.scene.mesh, options)?;
        let surface = interpolate(colors, &fragments)?;
        let background = match self.has_background {
            true => Background::Image(tape.leaf(&start.background)),
            false => Background::Zero,
        };
        let picture = antialias(composite(surface, &fragments, background)?)?;
        let mut image = picture.image()?;
        if self.sigma.is_some() {
            image = gaussian_blur(image, sigma, &Blur::default())?;
        }
        let loss = squared_error(image, tape.constant(&start.target))?;
        let mut results = Vec::new();
        if look {
            results.extend([("picture", image.value()), ("loss", loss.value())]);
        }
        if !self.learns() {
            return Ok(results);
        }
        let gradients = match self.has_depth {
            false => loss.backward()?,
            true => {
                let depth = depth(&fragments)?;
                let zeros = || Tensor::zeros(depth.shape());
                let upstream = start.depth_upstream.get_or_insert_with(zeros);
                tape.vjp(&[(loss, &start.one), (depth, upstream)])?
            }
        };
        let learnt = [
            ("gradient of positions", self.learns_positions, positions),
            ("gradient of colours", self.learns_colors, colors),
            ("gradient of sigma", self.learns_sigma, sigma),
        ];
        for (name, _, variable) in learnt.into_iter().filter(|(_, learnt, _)| look && *learnt) {
            results.push((name, gradients.get_or_zeros(variable)));
        }
        Ok(results)
    }
}

/// The tensors that a step starts from.
struct Start {
    positions: Tensor<f32>,
    colors: Tensor<f32>,
    sigma: Tensor<f32>,
    background: Tensor<f32>,
    target: Tensor<f32>,
    one: Tensor<f32>,
    /// Zeros, once their number is known.
    depth_upstream: Option<Tensor<f32>>,
}

/// The pairs of steps: the first computes what the second has no need of.
fn pairs(pixels: usize) -> Result<Vec<(&'static str, Step, Step)>, FitError> {
    let scene = Scene::sphere("sphere1k", 32, 17, pixels)?;
    let (all, sharp) = (Step::new(&scene), Step::sharp(&scene));
    let (crossing, apart) = beside_the_near_plane(&scene)?;
    let [torn, whole] = walls(pixels)?;
    Ok(vec![
        ("frozen positions", all.clone(), Step { learns_positions: false, ..all.clone() }),
        ("frozen colours", all.clone(), Step { learns_colors: false, ..all.clone() }),
        ("frozen sigma", all.clone(), Step { learns_sigma: false, ..all.clone() }),
        // So narrow a window has the weight 1 at its centre and nothing else.
        (
            "sigma 0",
            Step { sigma: Some(1e-3), ..all.clone() },
            Step { sigma: Some(0.0), ..all.clone() },
        ),
        ("antialias without discontinuities", Step::sharp(&torn), Step::sharp(&whole)),
        ("empty background", Step { has_background: true, ..sharp.clone() }, sharp.clone()),
        ("no face near the near plane", Step::sharp(&crossing), Step::sharp(&apart)),
        ("depth not asked for", Step { has_depth: true, ..sharp.clone() }, sharp.clone()),
        (
            "inference without gradients",
            all.clone(),
            Step {
                learns_positions: false,
                learns_colors: false,
                learns_sigma: false,
                ..all.clone()
            },
        ),
    ])
}

/// The scene with a face that reaches through the near plane beside the image, and without; its
/// three vertices are there in both.
fn beside_the_near_plane(scene: &Scene) -> Result<(Scene, Scene), FitError> {
    // Clip coordinates with w = 2, -2 and 2: x / w is 4.5 and more, to the right of the image, but
    // the vertex behind the eye has x < -w, so that no plane has all three beyond it.
    let (back, corners) =
        (scene.camera.inverse(), [(9.0, 0.0, 2.0), (-9.0, 1.0, -2.0), (12.0, 0.0, 2.0)]);
    let mut positions = scene.positions.data().to_vec();
    for (x, y, w) in corners {
        // What the camera makes of a depth of w.
        let z = (51.0 * w - 100.0) / 49.0;
        let point = back * DVec4::new(x, y, z, w);
        positions.extend(point.truncate().to_array());
    }
    let count = scene.mesh.vertex_count();
    let colors = [scene.colors.data(), &[0.5; 9]].concat();
    let with = |faces: Vec<[u32; 3]>| {
        Ok::<_, FitError>(Scene {
            mesh: Mesh::new(faces, count + 3)?,
            positions: Tensor::new([count + 3, 3], positions.clone())?,
            colors: Tensor::new([count + 3, 3], colors.clone())?,
            ..scene.clone()
        })
    };
    let apart = scene.mesh.faces().to_vec();
    let mut crossing = apart.clone();
    crossing.push([0, 1, 2].map(|k| count as u32 + k));
    Ok((with(crossing)?, with(apart)?))
}

/// Quads per side of the walls.
const QUADS: usize = 8;

/// A wall of one colour that fills the image and more, once with vertices of its own for every
/// face, so that all edges within it are silhouettes, whose blends change nothing, and once with
/// shared ones, so that none is.
fn walls(pixels: usize) -> Result<[Scene; 2], FitError> {
    let side = QUADS + 1;
    let mut shared = Vec::new();
    for k in 0..side * side {
        // A plane through the object's origin that faces the camera, larger than the view.
        let place = |at: usize| 4.0 * at as f64 / QUADS as f64 - 2.0;
        shared.push([place(k % side), place(k / side)]);
    }
    let mut faces = Vec::new();
    for k in (0..QUADS * side).filter(|k| k % side < QUADS) {
        let (a, b, c, d) = (k, k + 1, k + side, k + side + 1);
        faces.extend([[a, b, d], [a, d, c]].map(|face| face.map(|vertex| vertex as u32)));
    }
    let model = Scene::cube(pixels)?;
    let (camera, size) = (model.camera, Size::square(pixels));
    let back = camera.inverse();
    let scene = |name: &str, faces: Vec<[u32; 3]>, vertices: Vec<[f64; 2]>| {
        // At w = 3.5, the distance of the object's origin.
        let w = 3.5;
        let point = |&[x, y]: &[f64; 2]| {
            let point = back * DVec4::new(x * w, y * w, (51.0 * w - 100.0) / 49.0, w);
            point.truncate().to_array()
        };
        let positions: Vec<f64> = vertices.iter().flat_map(point).collect();
        Ok::<_, FitError>(Scene {
            name: name.to_owned(),
            mesh: Mesh::new(faces, vertices.len())?,
            colors: Tensor::full([vertices.len(), 3], 0.5),
            positions: Tensor::new([vertices.len(), 3], positions)?,
            camera,
            size,
        })
    };
    let apart = faces.iter().flatten().map(|&vertex| shared[vertex as usize]).collect();
    let own = (0..faces.len() as u32).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    Ok([scene("torn wall", own, apart)?, scene("whole wall", faces, shared)?])
}

/// Whether two tensors have the same bits.
fn same_bits(a: &Tensor<f32>, b: &Tensor<f32>) -> bool {
    let bits = |tensor: &Tensor<f32>| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    a.shape() == b.shape() && bits(a) == bits(b)
}

/// What a step gives, and what its report says.
struct Look {
    results: Results,
    /// What is named as left out.
    named: Vec<String>,
    operations: Vec<&'static str>,
}

/// A look at one step.
fn look(step: &Step) -> Result<Look, FitError> {
    let tape = Tape::new();
    let results = step.take(&mut step.start(), &tape, true)?;
    let report = tape.take_report();
    let left_out = report.left_out.iter();
    let named = left_out.map(|entry| format!("{}: {}", entry.name, entry.reason)).collect();
    let operations = report.operations.iter().map(|entry| entry.name).collect();
    Ok(Look { results, named, operations })
}

/// A step over and over.
fn contestant<'a>(step: &'a Step, bench: &'a Bench) -> Contestant<'a> {
    let (mut start, mut tape) = (step.start(), Tape::new());
    Contestant::new(bench.one(), move || {
        step.take(&mut start, &tape, false)?;
        tape.reset();
        Ok(())
    })
}

/// Measures every row, on one thread.
///
/// # Errors
/// What an operation refuses: none does.
pub fn elision(effort: Effort) -> Result<Vec<Row>, FitError> {
    let bench = Bench::new(effort, Vec::new())?;
    let mut rows = Vec::new();
    for (row, computed, left) in pairs(effort.choose(32, 256))? {
        let (with, mut without) =
            bench.one().install(|| Ok::<_, FitError>((look(&computed)?, look(&left)?)))?;
        let mut left_out = std::mem::take(&mut without.named);
        left_out.retain(|one| !with.named.contains(one));
        let missing = with.operations.iter().filter(|name| !without.operations.contains(name));
        left_out.extend(missing.map(|name| format!("{name}: not recorded")));
        let both = without.results.iter().filter_map(|(name, found)| {
            let (_, other) = with.results.iter().find(|(other, _)| other == name)?;
            // The gradients of the walls' vertices are of different vertices.
            (found.shape() == other.shape()).then(|| (*name, same_bits(found, other)))
        });
        let results = both.collect();
        let mut contestants = [contestant(&computed, &bench), contestant(&left, &bench)];
        let mut timings = interleaved(&mut contestants, effort, GENEROUS).into_iter();
        let mut next = || timings.next().expect("one for each contestant");
        let (with, without) = (next()?, next()?);
        rows.push(Row { row, results, left_out, with, without });
    }
    Ok(rows)
}

/// The rows as a table.
fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "rows",
        "Microseconds of a step with it computed and without",
        &[
            ("left out", "row"),
            ("with, µs", "microseconds_with"),
            ("median", "median_microseconds_with"),
            ("without, µs", "microseconds_without"),
            ("median", "median_microseconds_without"),
            ("without / with", "ratio"),
            ("quartiles apart, %", "spread_percent"),
            ("without it is", "time_without"),
            ("samples", "samples"),
            ("same bits", "bitwise_equal"),
            ("results", "results"),
            ("named in the report", "left_out"),
        ],
    );
    for row in rows {
        let Row { with, without, .. } = row;
        table.push(vec![
            Cell::text(row.row),
            Cell::timed(with, row.microseconds_with()),
            Cell::timed(with, 1e6 * with.median),
            Cell::timed(without, row.microseconds_without()),
            Cell::timed(without, 1e6 * without.median),
            Cell::number(without.minimum / with.minimum),
            Cell::timed(with, 100.0 * with.spread().max(without.spread())),
            Cell::text(row.verdict()),
            Cell::Count(with.samples.min(without.samples)),
            Cell::text(if row.bitwise_equal() { "yes" } else { "NO" }),
            Cell::Count(row.results.len()),
            match row.left_out.is_empty() {
                true => Cell::Nothing,
                false => Cell::text(row.left_out.join("; ")),
            },
        ]);
    }
    table
}

/// What the table shows.
const NOTE: &str = "Each step is taken with one thing computed and without it, on a sphere of 1024 \
    faces (f32, one thread): positions, colours and sigma are learnt, sigma is 1, the background \
    empty, where the row does not say otherwise. The counterpart of sigma 0 is a window with nothing \
    but its centre; of an empty background one of zeros that is learnt; of a scene without \
    discontinuities, a wall that fills the image, the same wall with all faces apart; of no face near \
    the near plane one that reaches through it beside the image; of a depth that nobody asks for one \
    with an upstream gradient of zeros; of inference a step with all gradients. Compared are the \
    picture, the loss, and each gradient that both steps have. Samples of both are taken in turns; \
    times are equal where the ranges between their quartiles meet, of which the wider is given as a \
    share of its median.";

/// The rows as Markdown.
pub fn elision_markdown(rows: &[Row], effort: Effort) -> String {
    let method = crate::bench::study::wrapped(&method(effort));
    format!("{method}\n\n{}\n\n{}", crate::bench::study::wrapped(NOTE), table(rows).markdown())
}

/// Writes the page `elision.html` and `elision-rows.csv` into `folder`; returns the path of the page.
///
/// # Errors
/// [`ReportError::Write`] where the file system refuses.
pub fn write_elision_page(
    rows: &[Row],
    effort: Effort,
    footer: &str,
    folder: &Path,
) -> Result<PathBuf, ReportError> {
    let table = table(rows);
    let page = Document {
        title: "Bokashi: what is left out".to_owned(),
        heading: "What a scene does not need".to_owned(),
        introduction: escaped(&method(effort)),
        sections: vec![Section {
            id: "rows",
            title: "With and without",
            body: format!("<p>{}</p>{}", escaped(NOTE), table.html()),
        }],
        footer: format!("{footer} Beside this page: <code>elision-rows.csv</code>."),
    };
    write_csv(&table, "elision", folder)?;
    add_page(folder, "elision.html", &page.html())
}
