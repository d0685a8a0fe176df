//! Every public error can be met through the public interface, and says the rule, then the value.
//!
//! The enums can grow, so no `match` from outside can tell that one is forgotten: the names of
//! their variants are read from their source.

use std::collections::BTreeSet;
use std::error::Error;
use std::fmt::{Debug, Display};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use bokashi_core::{ForwardDual, Scalar, Tape, Tensor, TensorError, Var, value_errors};
use bokashi_fit::{
    Fit, FitError, FitSettings, Mapping, Optimizer, Parameter, Parameters, Ranks, Schedule, agree,
    check_alike, check_same, from_fn, mean_squared_error, on_ranks, views,
};
use bokashi_mesh::{AtlasOptions, Grid, MeshError, atlas, nearest_on_surface, normal_consistency};
use bokashi_render_ops::{
    Background, Blur, Coverage, Detail, Fragments, Kernel, Layer, Mesh, Prefilter, RasterOptions,
    RenderError, Sampler, Sampling, Silhouettes, Size, Texture, TextureFilter, antialias,
    antialias_image, composite, composite_layers, depth_layers, gaussian_blur, interpolate,
    rasterize, rasterize_behind, sample_texture,
};

/// The names of the variants of `pub enum <name>` in a source file.
fn variants(path: &str, name: &str) -> BTreeSet<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let source = fs::read_to_string(&path).unwrap();
    let start = format!("pub enum {name} {{\n");
    let (_, body) = source.split_once(&start).expect("the enum is there");
    let (body, _) = body.split_once("\n}").expect("the enum ends");
    let lines = body.lines().filter_map(|line| line.strip_prefix("    "));
    let heads = lines.filter(|line| line.starts_with(|first: char| first.is_ascii_uppercase()));
    heads.map(first_word).collect()
}

fn first_word(text: &str) -> String {
    text.chars().take_while(char::is_ascii_alphanumeric).collect()
}

/// The variants of an error that operations of the catalogue refuse wrong inputs with: the laws compare
/// their messages.
fn met_in_the_catalogue<E: Error + 'static>() -> BTreeSet<String> {
    let entries = bokashi_catalogue::ENTRIES.iter().map(|entry| entry());
    let met = entries.flat_map(|entry| {
        let refusals = entry.checks().iter().flat_map(|check| check.refusals());
        let name = |error: &E| first_word(&format!("{error:?}"));
        let errors = refusals.filter_map(|(_, error)| error?.downcast_ref::<E>().map(name));
        errors.collect::<Vec<_>>()
    });
    met.collect()
}

/// Each error with the message it should have; every variant has to be among them, or else in `met`.
fn assert_messages<E: Debug + Display>(
    all: &BTreeSet<String>,
    table: Vec<(E, String)>,
    mut met: BTreeSet<String>,
) {
    for (error, message) in table {
        assert_eq!(error.to_string(), message, "{error:?}");
        met.insert(first_word(&format!("{error:?}")));
    }
    let forgotten: Vec<_> = all.difference(&met).collect();
    assert!(forgotten.is_empty(), "no test meets {forgotten:?}");
    assert!(met.is_subset(all), "the source was read wrongly: {all:?}");
}

#[test]
fn every_tensor_error_says_the_rule_and_the_value() {
    let (tape, other) = (Tape::<f64>::new(), Tape::new());
    let zeros = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let (pair, foreign) = (zeros(&[2]), other.leaf_scalar(1.0));
    let table: Vec<(TensorError, &str)> = vec![
        (Tensor::new([2, 3], vec![0.0; 5]).unwrap_err(), "shape [2, 3] needs 6 entries, got 5"),
        (
            tape.vjp(&[(pair, &Tensor::zeros([3]))]).unwrap_err(),
            "backward needs an upstream gradient of its variable's shape, got shapes [3] and [2]",
        ),
        (
            zeros(&[1 << 20, 1]).try_add(zeros(&[1, 1 << 20])).unwrap_err(),
            "add needs memory for its output, got shape [1048576, 1048576]",
        ),
        (
            // What an operation of one's own may say: a rule that names its number.
            TensorError::Value {
                operation: "spline",
                rule: format!("an order below {}", 4).into(),
                value: 7.0,
            },
            "spline needs an order below 4, got 7",
        ),
        (pair.try_mul(foreign).unwrap_err(), "mul needs variables of one tape, got one of another"),
        (
            pair.backward().unwrap_err(),
            "a backward pass without an upstream gradient needs a scalar, got shape [2]",
        ),
        (
            Tape::new().leaf_scalar(ForwardDual::<f64>::ONE).backward().unwrap_err(),
            "a backward pass needs numbers that are not forward-only, got \
             bokashi_core::dual::Dual<f64, false>",
        ),
        (
            value_errors(&tape, &other).unwrap_err(),
            "a comparison needs two recordings of one pipeline, got a leaf and nothing as value 1",
        ),
    ];
    let all = variants("crates/core/src/error.rs", "TensorError");
    let table = table.into_iter().map(|(error, message)| (error, message.to_owned()));
    assert_messages(&all, table.collect(), met_in_the_catalogue::<TensorError>());
}

/// A grey layer.
fn layer_of<'a, 't>(fragments: &'a Fragments<'t, f64>, tape: &'t Tape<f64>) -> Layer<'a, 't, f64> {
    let count = fragments.coverage.count();
    let premultiplied = tape.constant_full([count, 1], 0.5);
    Layer { fragments, premultiplied, alpha: tape.constant_full([count], 0.5) }
}

#[test]
fn every_render_error_says_the_rule_and_the_value() {
    let (tape, other) = (Tape::<f64>::new(), Tape::new());
    let zeros = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let corners = vec![-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], corners).unwrap());
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let fragments = rasterize(clip, &mesh, Size::square(4)).unwrap();
    let options = RasterOptions::new(fragments.coverage.size()).sampling(Sampling::Exact);
    let exact = rasterize(clip, fragments.coverage.mesh(), options.creases(&[])).unwrap();
    let pixels = exact.coverage.boundary_counts().pixels;
    let values = tape.leaf(&Tensor::zeros([exact.coverage.count(), 1]));
    let pieces = exact.coverage.count() - exact.coverage.centers();
    let weightless = Fragments { weight: None, ..exact.clone() };
    let weightless = composite(values, &weightless, Background::Zero).map(drop);
    let exact = antialias(composite(values, &exact, Background::Zero).unwrap()).map(drop);
    let eight_probes = TextureFilter::Anisotropic { probes: 8 };
    let looked_up = |sampler| {
        let texture = Texture::new(tape.constant_full([1, 1, 1], 0.5)).unwrap();
        sample_texture(&texture, zeros(&[1, 2]), Detail::Finest, sampler).unwrap_err()
    };
    let larger = Tensor::from_flat_fn(
        [3, 4],
        |k| if k % 4 < 2 { 3.0 } else { 1.0 } * clip.value().data()[k],
    );
    let larger = rasterize(tape.leaf(&larger), &mesh, Size::square(4)).unwrap();
    let mut covered = larger.coverage.pixels();
    let uncovered = covered.find(|&pixel| fragments.coverage.fragment_at(pixel).is_none());
    let layer = |fragments| layer_of(fragments, &tape);
    let ids = fragments.coverage.triangle_ids();
    let coverage = Coverage::from_ids(&mesh, Size::square(4), &ids).unwrap();
    let of_ids = Fragments { coverage: Arc::new(coverage), ..fragments.clone() };
    let image = zeros(&[4, 4, 1]);

    let table: Vec<(RenderError, &str)> = vec![
        (
            interpolate(other.leaf(&Tensor::zeros([3, 1])), &fragments).map(drop).unwrap_err(),
            "interpolate needs variables of one tape, got one of another",
        ),
        (
            Mesh::new(vec![[0, 1, 2], [0, 3, 1]], 3).unwrap_err(),
            "a face needs vertex indices below 3, got 3 in face 1",
        ),
        (mesh.part(1..3).unwrap_err(), "a part of a mesh needs a range of its 1 faces, got 1..3"),
        (
            Coverage::from_ids(&mesh, Size { width: 3, height: 2 }, &[0, 1, 1, 0, 2, 3])
                .unwrap_err(),
            "a triangle id needs to be at most the number of faces, 1, got 2 at pixel 4",
        ),
        (
            antialias_image(image, &of_ids).map(drop).unwrap_err(),
            "antialias_image needs to know which way faces turn: \
             `coverage.with_orientations(&clip, cull)`",
        ),
        (
            Mesh::new(vec![], 1 << 31).unwrap_err(),
            "a mesh needs fewer than 2^31 faces and vertices, got 2147483648",
        ),
        (
            weightless.unwrap_err(),
            "composite needs a weight for each of the [pieces] pieces of exact coverage, got none",
        ),
        (
            exact.unwrap_err(),
            "antialias needs one fragment per pixel, got exact coverage with [pixels] boundary \
             pixels",
        ),
        (
            rasterize(clip, &mesh, options).unwrap_err(),
            "rasterize with exact coverage needs the attributes that will be shown, \
             `options.creases(&[colors.into()])`, or `&[]` for none that varies, got options alone",
        ),
        (
            "soft".parse::<Silhouettes>().unwrap_err(),
            "silhouettes need to be aliased, antialias or exact, got \"soft\"",
        ),
        (
            "disk".parse::<Kernel>().unwrap_err(),
            "a kernel needs to be unnormalized, sampled, discrete or disc, got \"disk\"",
        ),
        (
            looked_up(Sampler::new().filter(eight_probes)),
            "sample_texture needs differentials for more than one probe, got 8",
        ),
        (
            Prefilter::<f64>::new(24, 3).map(drop).unwrap_err(),
            "prefilter needs an extent that is a power of two up to 256, got 24",
        ),
        (
            depth_layers(clip, &mesh, options, None).unwrap_err(),
            "depth_layers needs fragments at pixel centres, got exact coverage, \
             whose pieces say nothing of what lies behind them",
        ),
        (
            composite_layers::<f64>(&[], Background::Zero).unwrap_err(),
            "composite_layers needs at least one layer, got none",
        ),
        (
            composite_layers(&[layer(&fragments), layer(&larger)], Background::Zero).unwrap_err(),
            "layers need to follow each other from the front, \
             got layer 1 at pixel [uncovered], where layer 0 is not",
        ),
        (
            rasterize_behind(&fragments, Size::square(8)).unwrap_err(),
            "a layer needs the size of the layer in front, 4 x 4, got 8 x 8",
        ),
    ];
    let all = variants("crates/render-ops/src/error.rs", "RenderError");
    let told = |message: &str| {
        let message = message.replace("[uncovered]", &uncovered.unwrap().to_string());
        message.replace("[pieces]", &pieces.to_string()).replace("[pixels]", &pixels.to_string())
    };
    let table = table.into_iter().map(|(error, message)| (error, told(message)));
    // A transparent error shows the one below it: by name it is `Tensor`.
    assert_messages(&all, table.collect(), met_in_the_catalogue::<RenderError>());
}

#[test]
fn every_mesh_error_says_the_rule_and_the_value() {
    let points = Tensor::<f64>::zeros([3, 3]);
    let (flat, empty) = (Mesh::new(vec![[0, 1, 2]], 3).unwrap(), Mesh::new(vec![], 3).unwrap());
    let apart = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
    let corners = Tensor::from_flat_fn([6, 3], |k| [0.0, 1.0, 2.0, 4.0, 9.0][k * k % 5]);
    let table: Vec<(MeshError, &str)> = vec![
        (
            Grid::new([4, 1, 3], [0.0; 3], 1.0).unwrap_err(),
            "a grid needs at least 2 points along each axis and fewer than 2^31 in all, \
             got 4 x 1 x 3",
        ),
        (
            Grid::new([2; 3], [0.0, 0.5, 0.0], -1.0).unwrap_err(),
            "a grid needs finite points and a positive spacing, \
             got origin [0.0, 0.5, 0.0] and spacing -1",
        ),
        (
            Grid::around([0.0, 0.5, 0.0], [1.0, 0.25, 1.0], 8).unwrap_err(),
            "a grid needs a box that starts below its end, \
             got one from [0.0, 0.5, 0.0] to [1.0, 0.25, 1.0]",
        ),
        (
            nearest_on_surface(&points, &points, &empty).map(drop).unwrap_err(),
            "nearest_on_surface needs a mesh with faces, got none",
        ),
        (
            normal_consistency((&points, &flat), (&points, &flat), 9, 0).unwrap_err(),
            "normal_consistency needs a face with an area, got none among 1",
        ),
        (
            // Of two faces that share no edge.
            atlas(&corners, &apart, &AtlasOptions::new(3)).map(drop).unwrap_err(),
            "an atlas of 2 charts needs more texels than 3 x 3",
        ),
        (
            Mesh::new(vec![[0, 1, 3]], 3).unwrap_err().into(),
            "a face needs vertex indices below 3, got 3 in face 0",
        ),
    ];
    let all = variants("crates/mesh/src/error.rs", "MeshError");
    let table = table.into_iter().map(|(error, message)| (error, message.to_owned()));
    assert_messages(&all, table.collect(), met_in_the_catalogue::<MeshError>());
}

/// What a step of a fit of one parameter x, from `start`, says.
fn step(
    start: Parameter<f32>,
    settings: FitSettings,
    loss: impl for<'t> Fn(Var<'t, f32>) -> Result<Var<'t, f32>, FitError>,
) -> FitError {
    let parameters = Parameters::new().with(start).unwrap();
    let mut fit = Fit::new(parameters, settings).unwrap();
    fit.step(&mut from_fn(|_: &Tape<f32>, variables| loss(variables.get("x")?))).unwrap_err()
}

/// The error of `work` on the first of two ranks.
fn said_by_rank_0(work: impl Fn(&Ranks<f32>) -> Result<(), FitError> + Sync) -> FitError {
    let said = on_ranks(2, |ranks| work(&ranks));
    said.into_iter().next().expect("two ranks").unwrap_err()
}

#[test]
fn every_fit_error_says_the_rule_and_the_value() {
    let x = |value: f32| Parameter::new("x", Tensor::scalar(value));
    let settings = FitSettings::default();
    let nowhere = std::num::ParseIntError::clone(&"q".parse::<i32>().unwrap_err());
    let message = nowhere.to_string();
    let said = fs::read("nowhere/fit.bokashi").unwrap_err();
    let missing = format!("nowhere/fit.bokashi could not be read: {said}");
    let descent = FitSettings { optimizer: Optimizer::GradientDescent, ..settings };
    let table: Vec<(FitError, &str)> = vec![
        (
            step(x(1.0), settings, |x| {
                Ok(mean_squared_error(x, x.tape().leaf(&Tensor::zeros([2])))?)
            }),
            "mean_squared_error needs an image and a reference of one shape, got shapes [] and [2]",
        ),
        (
            step(x(1.0), settings, |x| Ok(gaussian_blur(x, x, &Blur::default())?)),
            "gaussian_blur needs an image of shape [H, W, C] with at least one entry, got shape []",
        ),
        (step(x(1.0), settings, |_| Err(FitError::operation(nowhere.clone()))), &message),
        (
            step(x(1e30), settings, |x| Ok(x.square())),
            "the loss needs to be finite, got inf at step 0, first in the output of powi of \"x\"",
        ),
        (
            step(x(0.0), settings, |x| Ok(x.sqrt())),
            "the gradient of \"x\" needs to be finite, got inf at step 0, \
             first in the backward pass of sqrt",
        ),
        (
            step(x(1.0), settings, |x| Ok(x.exp().detach())),
            "\"x\" needs a way to the loss, got one that ends at exp, whose output is detached",
        ),
        (
            step(x(1.0), settings, |x| Ok(x * 1e30)),
            "the squared gradient of \"x\" needs to be finite, got inf at step 0",
        ),
        (
            Fit::new(Parameters::new().with(x(2.0)).unwrap(), settings)
                .unwrap()
                .step(&mut views(3, |view, tape, variables| {
                    // The view at index 1 has another size.
                    let size = [1 + view.index % 2];
                    Ok(mean_squared_error(
                        variables[0].reshape([1])?,
                        tape.constant(&Tensor::zeros(size)),
                    )?)
                }))
                .map(drop)
                .unwrap_err(),
            "view 1: mean_squared_error needs an image and a reference of one shape, got shapes [1] and [2]",
        ),
        (
            // Its logarithm rounds up, and e to the power of that overflows.
            step(x(f32::MAX).mapping(Mapping::Exp), settings, |x| Ok(-x)),
            "the value of \"x\" needs to be finite, got inf at step 0",
        ),
        (
            // A step to a raw number whose value is none.
            step(x(1.0).mapping(Mapping::Exp).rate(1e4), descent, |x| Ok(-x)),
            "the update of \"x\" needs to be finite, got inf at step 0",
        ),
        (
            Fit::<f32>::from_bytes(b"GIF89a, and what not").map(drop).unwrap_err(),
            "a saved fit needs a safetensors file, got header too large",
        ),
        (Fit::<f32>::resume("nowhere/fit.bokashi").map(drop).unwrap_err(), &missing),
        (
            Parameters::<f32>::new().with(x(1.0)).unwrap().value("y").unwrap_err(),
            "a parameter's name needs to be one of [\"x\"], got \"y\"",
        ),
        (
            Fit::<f32>::new(
                Parameters::new(),
                FitSettings { schedule: Schedule::Step { steps: 0, factor: 0.5 }, ..settings },
            )
            .map(drop)
            .unwrap_err(),
            "schedule needs a period of at least 1 step, got 0",
        ),
        (
            said_by_rank_0(|ranks| {
                let own = match ranks.rank() {
                    0 => Ok(vec![]),
                    rank => Err(FitError::setting("view", "an image", rank)),
                };
                agree(&**ranks, own).map(drop)
            }),
            "rank 1: view needs an image, got 1",
        ),
        (
            said_by_rank_0(|ranks| {
                let start = x(if ranks.rank() == 1 { -0.0 } else { 0.0 });
                check_same(&**ranks, &Parameters::new().with(start).unwrap(), 12)
            }),
            "all ranks need the same parameters, got others on rank 1 at step 12",
        ),
        (
            said_by_rank_0(|ranks| {
                let size = (32 + 32 * ranks.rank()).to_string();
                check_alike(&**ranks, &[("size".to_owned(), size)].into())
            }),
            "all ranks need the same files and settings, got another size on rank 1: it has 64, and rank 0 has 32",
        ),
    ];
    let met: BTreeSet<_> = table
        .iter()
        .filter_map(|(error, _)| match error {
            FitError::NotFinite { quantity, .. } => Some(first_word(&format!("{quantity:?}"))),
            _ => None,
        })
        .collect();
    assert_eq!(met, variants("crates/fit/src/error.rs", "Quantity"));
    let all = variants("crates/fit/src/error.rs", "FitError");
    let table = table.into_iter().map(|(error, message)| (error, message.to_owned()));
    assert_messages(&all, table.collect(), BTreeSet::new());
}

#[test]
fn a_variant_that_nothing_meets_is_noticed() {
    let all = variants("crates/core/src/error.rs", "TensorError");
    assert!(all.contains("Length") && all.contains("NotScalar") && all.len() >= 10, "{all:?}");
    let only = vec![(TensorError::ForeignVariable { operation: "x" }, String::new())];
    let only = only.into_iter().map(|(error, _)| {
        let message = error.to_string();
        (error, message)
    });
    let checked =
        std::panic::catch_unwind(|| assert_messages(&all, only.collect(), BTreeSet::new()));
    assert!(checked.is_err());
}
