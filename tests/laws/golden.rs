//! The golden cases: values and gradients of five small scenes, from an independent implementation
//! in float64, held to 1e-9 in f64 and to 1e-4 of each array's largest entry in f32.

use std::path::Path;

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Composite, Fragments, Kernel, Mesh, Radius, Size, antialias,
    composite, depth, gaussian_blur, interpolate, rasterize,
};
use serde::Deserialize;

type Rows = Vec<Vec<f64>>;
type Image = Vec<Rows>;

#[derive(Deserialize)]
struct Golden {
    height: usize,
    width: usize,
    clip: Rows,
    faces: Vec<[u32; 3]>,
    attributes: Rows,
    triangle_id: Vec<Vec<u32>>,
    barycentric_uv: Image,
    depth_z_over_w: Rows,
    interpolated: Image,
    /// Absent where the near plane cuts the mesh.
    antialiased: Option<Image>,
    grad_of_interpolated: Gradients,
    grad_of_antialiased: Option<Gradients>,
    #[serde(default)]
    blur: Vec<Blurred>,
}

#[derive(Deserialize)]
struct Gradients {
    upstream: Image,
    clip: Rows,
    attributes: Rows,
}

#[derive(Deserialize)]
struct Blurred {
    kernel: String,
    border: String,
    sigma: f64,
    radius: usize,
    output: Image,
    grad: BlurGradients,
}

#[derive(Deserialize)]
struct BlurGradients {
    #[serde(flatten)]
    below: Gradients,
    sigma: f64,
}

fn golden(name: &str) -> Golden {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(name).with_extension("json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path:?}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{path:?}: {error}"))
}

fn flat(rows: &Rows) -> Vec<f64> {
    rows.concat()
}

fn flat_image(image: &Image) -> Vec<f64> {
    image.iter().flat_map(flat).collect()
}

/// A scene on a tape of a precision, and the tolerance that it is held to.
struct Scene<'t, T: Scalar> {
    golden: &'t Golden,
    tolerance: f64,
    clip: Var<'t, T>,
    attributes: Var<'t, T>,
    fragments: Fragments<'t, T>,
    /// The interpolated attributes before a black background.
    picture: Composite<'t, T>,
    image: Var<'t, T>,
}

impl<'t, T: Scalar> Scene<'t, T> {
    fn new(golden: &'t Golden, tape: &'t Tape<T>, tolerance: f64) -> Self {
        let leaf = |rows: &Rows| tape.leaf(&tensor([rows.len(), rows[0].len()], &flat(rows)));
        let (clip, attributes) = (leaf(&golden.clip), leaf(&golden.attributes));
        let mesh = Mesh::new(golden.faces.clone(), golden.clip.len()).unwrap();
        let size = Size { width: golden.width, height: golden.height };
        let fragments = rasterize(clip, &mesh, size).unwrap();
        let values = interpolate(attributes, &fragments).unwrap();
        let picture = composite(values, &fragments, Background::Zero).unwrap();
        let image = picture.image().unwrap();
        Self { golden, tolerance, clip, attributes, fragments, picture, image }
    }

    /// Entry by entry within the tolerance of the largest expected entry.
    fn assert_close(&self, what: &str, found: &Tensor<T>, expected: &[f64]) {
        assert_eq!(found.size(), expected.len(), "{what}");
        let largest = expected.iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
        for (k, (found, expected)) in found.data().iter().zip(expected).enumerate() {
            let error = (found.to_f64() - expected).abs();
            assert!(
                error <= self.tolerance * largest,
                "{what}, entry {k}: {found} instead of {expected}, off by {:.1e} of the largest",
                error / largest
            );
        }
    }

    /// The gradients of `sum(upstream * of)` with respect to clip positions and attributes.
    fn assert_gradients(&self, what: &str, of: Var<'t, T>, expected: &Gradients) {
        let upstream = tensor(of.shape(), &flat_image(&expected.upstream));
        let gradients = of.tape().vjp(&[(of, &upstream)]).unwrap();
        let (clip, attributes) = (flat(&expected.clip), flat(&expected.attributes));
        self.assert_close(
            &format!("clip gradient of {what}"),
            &gradients.get_or_zeros(self.clip),
            &clip,
        );
        let found = gradients.get_or_zeros(self.attributes);
        self.assert_close(&format!("attribute gradient of {what}"), &found, &attributes);
    }

    fn check(&self) {
        let golden = self.golden;
        assert_eq!(self.fragments.coverage.triangle_ids(), golden.triangle_id.concat());

        let size = Size { width: golden.width, height: golden.height };
        let dense = |values: Var<'t, T>, channels: usize| {
            let rows =
                values.value().reshaped([self.fragments.coverage.count(), channels]).unwrap();
            let values = values.tape().constant(&rows);
            composite(values, &self.fragments, Background::Zero).unwrap().image().unwrap().value()
        };
        assert_eq!(self.fragments.coverage.size(), size);
        let barycentrics = dense(self.fragments.barycentrics, 2);
        // The golden arrays hold some numbers outside the triangles too.
        let covered: Vec<f64> =
            golden.triangle_id.concat().iter().map(|&id| id.min(1).into()).collect();
        let expected: Vec<f64> = flat_image(&golden.barycentric_uv)
            .iter()
            .enumerate()
            .map(|(k, uv)| uv * covered[k / 2])
            .collect();
        self.assert_close("barycentrics", &barycentrics, &expected);
        let depth = dense(depth(&self.fragments).unwrap(), 1);
        self.assert_close("depth", &depth, &flat(&golden.depth_z_over_w));
        self.assert_close("interpolated", &self.image.value(), &flat_image(&golden.interpolated));
        self.assert_gradients("interpolated", self.image, &golden.grad_of_interpolated);

        let (Some(expected), Some(gradients)) = (&golden.antialiased, &golden.grad_of_antialiased)
        else {
            assert!(golden.blur.is_empty());
            return;
        };
        let image = antialias(self.picture.clone()).unwrap().image().unwrap();
        self.assert_close("antialiased", &image.value(), &flat_image(expected));
        self.assert_gradients("antialiased", image, gradients);

        for blurred in &golden.blur {
            let what = format!("{} blur of {}", blurred.kernel, blurred.sigma);
            assert_eq!(blurred.border, "zero");
            let kernel = match blurred.kernel.as_str() {
                "seed" => Kernel::Unnormalized,
                "sampled" => Kernel::Sampled,
                other => panic!("no kernel is named {other}"),
            };
            let radius = Radius::Fixed(blurred.radius);
            let sigma = self.image.tape().leaf_scalar(T::from_f64(blurred.sigma));
            let blur = Blur { kernel, border: Border::Zero, radius };
            let out = gaussian_blur(image, sigma, &blur).unwrap();
            self.assert_close(&what, &out.value(), &flat_image(&blurred.output));
            self.assert_gradients(&what, out, &blurred.grad.below);
            let upstream = tensor(out.shape(), &flat_image(&blurred.grad.below.upstream));
            let gradients = out.tape().vjp(&[(out, &upstream)]).unwrap();
            self.assert_close(&what, gradients.get(sigma).unwrap(), &[blurred.grad.sigma]);
        }
    }
}

fn tensor<T: Scalar>(shape: impl Into<bokashi_core::Shape>, entries: &[f64]) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| T::from_f64(entries[k]))
}

fn check(name: &str) {
    let golden = golden(name);
    Scene::<f64>::new(&golden, &Tape::new(), 1e-9).check();
    Scene::<f32>::new(&golden, &Tape::new(), 1e-4).check();
}

#[test]
fn a_cube() {
    check("cube_16");
}

#[test]
fn a_perturbed_cube_on_a_wide_image() {
    check("cube_perturbed_12x20");
}

#[test]
fn a_cube_through_the_near_plane() {
    check("cube_through_near_plane_16");
}

#[test]
fn a_sphere_with_four_channels() {
    check("sphere_24");
}

#[test]
fn two_triangles_one_in_front_of_the_other() {
    check("two_triangles_occluding_15x17");
}
