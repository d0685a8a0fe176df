//! What does f64 cost over f32, operation by operation, and what does it buy?
//!
//! Each operation is recorded on the same inputs, which are exact in f32, and walked back from the
//! same upstream gradient. Times are the tape's own, of the operation alone.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use bokashi_core::{Mask, Padding, Scalar, SparseMatrix, Tape, Tensor, Var};
use bokashi_fit::{
    DepthAlignment, FitError, Penalty, RigidWeights, Rigidity, Topology, depth_error,
    edge_length_error, halved, mean_error, normal_error, silhouette_error, squared_error,
    ssim_error, total_variation,
};
use bokashi_render_ops::{
    Background, Blur, Border, CubeMap, DepthImage, Detail, Filter, Fragments, Layer, Lens,
    LensOptions, Light, Material, RasterOptions, Reference, Sampler, Surface, Texture,
    TextureFilter, Weighting, affine_inverse, antialias, composite, composite_layers, depth,
    depth_layers, depth_of_field, differentials, distort, downsample, eye_depth, face_normals,
    gaussian_blur, interpolate, interpolate_differentials, irradiance, orthographic, over,
    perturbed_normals, pinhole, project, project_instances, rasterize, rasterize_behind, reflect,
    rigid, sample_cube_map, sample_texture, se3, shade, srgb_decode, srgb_encode, tangents,
    transform_normals, transform_points, vertex_normals,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::difference::relative_error;
use crate::bench::effort::USUAL;
use crate::bench::pipeline::drawn;
use crate::bench::sampling::Timing;
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;
use crate::bench::study::Study;
use crate::bench::table::{Cell, Table};

/// Records an operation on variables of its inputs.
pub(super) type Record<T> = for<'t> fn(&Scene, &[Var<'t, T>]) -> Result<Var<'t, T>, FitError>;

/// An operation and what it is run on.
pub(super) struct Case<T: Scalar> {
    /// The name it has on the tape, and after a comma what it works on.
    pub(super) label: &'static str,
    pub(super) inputs: Vec<Tensor<f64>>,
    pub(super) record: Record<T>,
}

impl<T: Scalar> Case<T> {
    fn name(&self) -> &'static str {
        self.label.split(',').next().unwrap_or(self.label)
    }

    /// The operations that it stands for: its name is one, or several between "and".
    fn has(&self, operation: &str) -> bool {
        self.name().split(" and ").any(|name| name == operation)
    }
}

/// The fragments of the scene, on the tape as constants, with other barycentrics.
fn fragments<'t, T: Scalar>(
    scene: &Scene,
    clip: Var<'t, T>,
    barycentrics: Option<Var<'t, T>>,
) -> Result<Fragments<'t, T>, FitError> {
    let options = RasterOptions::from(scene.size);
    let found = rasterize(clip.detach(), &scene.mesh, options)?;
    let barycentrics = barycentrics.unwrap_or(found.barycentrics);
    Ok(Fragments { barycentrics, ..found })
}

/// Which vertices of the scene share an edge.
fn topology(scene: &Scene) -> Result<Topology, FitError> {
    Ok(Topology::new(scene.mesh.faces(), scene.mesh.vertex_count())?)
}

/// A metal or dielectric of the inputs 2 to 4.
pub(super) fn metal<'t, T: Scalar>(v: &[Var<'t, T>], conserves_energy: bool) -> Material<'t, T> {
    let (base_color, roughness, metallic) = (v[2], v[3], v[4]);
    Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy }
}

/// A surface with the normals and views of the inputs 0 and 1; its positions are the views.
pub(super) fn shaded<'t, T: Scalar>(
    v: &[Var<'t, T>],
    material: Material<'t, T>,
    light: Light<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let surface = Surface { normals: v[0], views: v[1], positions: Some(v[1]) };
    Ok(shade(&surface, &material, &[light])?)
}

/// Samples of a texture that was made mipmaps of, by the inputs texels, coordinates and differentials.
pub(super) fn textured<'t, T: Scalar>(
    v: &[Var<'t, T>],
    filter: TextureFilter,
) -> Result<Var<'t, T>, FitError> {
    let detail = Detail::Differentials { differentials: v[2], bias: None };
    let texture = Texture::with_mipmaps(v[0])?;
    Ok(sample_texture(&texture, v[1], detail, Sampler::new().filter(filter))?)
}

/// Every operation, with entries in numbers like those of a small image.
fn cases<T: Scalar>(inputs: &Inputs) -> Vec<Case<T>> {
    let Inputs { signed, positive, .. } = inputs;
    let mut all: Vec<Case<T>> = Vec::new();
    let mut add = |label, given: &[&Tensor<f64>], record: Record<T>| {
        let inputs = given.iter().map(|&tensor| tensor.clone()).collect();
        all.push(Case { label, inputs, record });
    };
    let Inputs { positions, clip, barycentrics, colors, surface, aliased, image, slopes, .. } =
        inputs;
    add("project", &[positions], |scene, v| Ok(project(v[0], &scene.camera, None)?));
    let motion = [Tensor::from([0.125, -0.25, 0.5, 1.0]), Tensor::from([0.25, -0.5, 1.0])];
    let intrinsics = Tensor::from([300.0, 280.0, 127.5, 120.25]);
    add("pinhole", &[&intrinsics], |scene, v| Ok(pinhole(v[0], scene.size, 0.1, 100.0)?));
    add("orthographic", &[&intrinsics], |scene, v| Ok(orthographic(v[0], scene.size, 0.1, 100.0)?));
    add("rigid", &[&motion[0], &motion[1]], |_, v| Ok(rigid(v[0], v[1])?));
    let increment = Tensor::from([0.25, -0.5, 1.0, 0.125, -0.25, 0.5]);
    add("se3", &[&increment], |scene, v| Ok(se3(v[0], &scene.camera)?));
    add("affine_inverse", &[&inputs.affine], |_, v| Ok(affine_inverse(v[0])?));
    add("transform_points", &[positions, &inputs.affine], |_, v| Ok(transform_points(v[0], v[1])?));
    let lens = Tensor::from([-0.25, 0.0625, 0.001953125, -0.00390625, 0.0078125]);
    add("distort", &[positions, &lens], |_, v| Ok(distort(v[0], v[1])?));
    add("project_instances", &[positions, &inputs.instances], |scene, v| {
        Ok(project_instances(v[0], v[1], &scene.camera)?)
    });
    add("face_normals", &[positions], |scene, v| Ok(face_normals(v[0], &scene.mesh)?));
    add("vertex_normals, by area", &[positions], |scene, v| {
        Ok(vertex_normals(v[0], &scene.mesh, Weighting::Area)?)
    });
    add("vertex_normals, by angle", &[positions], |scene, v| {
        Ok(vertex_normals(v[0], &scene.mesh, Weighting::Angle)?)
    });
    let turn =
        Tensor::from_flat_fn([3, 3], |k| [0.5, -0.75, 1.0, 1.5, 0.25, -0.5, 0.0, 1.0, 2.0][k]);
    add("transform_normals", &[positions, &turn], |_, v| Ok(transform_normals(v[0], v[1])?));
    add("tangents", &[positions, &inputs.normals, &inputs.coordinates], |scene, v| {
        Ok(tangents(v[0], v[1], v[2], &scene.mesh, &scene.mesh)?)
    });
    let [normals, tangents, values] = &inputs.frames;
    add("perturbed_normals", &[normals, tangents, values], |_, v| {
        Ok(perturbed_normals(v[0], v[1], v[2])?)
    });
    let [base, roughness, metallic, strength] = &inputs.material;
    let lit = [normals, values, base, roughness, metallic, &inputs.row, strength];
    add("shade, metallic-roughness", &lit, |_, v| {
        let light = Light::Directional { direction: v[5], irradiance: v[6] };
        shaded(v, metal(v, false), light)
    });
    add("shade, energy conserved", &lit, |_, v| {
        let light = Light::Directional { direction: v[5], irradiance: v[6] };
        shaded(v, metal(v, true), light)
    });
    add("shade, a point light", &lit, |_, v| {
        let light = Light::Point { position: v[5] * T::from_f64(4.0), intensity: v[6] };
        shaded(v, metal(v, false), light)
    });
    add("shade, ambient", &lit, |_, v| {
        shaded(v, metal(v, true), Light::Ambient { radiance: v[6] })
    });
    add("shade, Lambert", &[normals, values, base, &inputs.row, strength], |_, v| {
        let light = Light::Directional { direction: v[3], irradiance: v[4] };
        shaded(v, Material::Lambert { color: v[2] }, light)
    });
    add("shade, Blinn-Phong", &lit, |_, v| {
        let (exponent, light) =
            (v[3] * T::from_f64(20.0), Light::Directional { direction: v[5], irradiance: v[6] });
        shaded(v, Material::BlinnPhong { color: v[2], specular: v[6], exponent }, light)
    });
    let coefficients = Tensor::from_flat_fn([9, 3], |k| 1.0 / (1.0 + k as f64 / 4.0).floor());
    add("irradiance", &[&coefficients, normals], |_, v| Ok(irradiance(v[0], v[1])?));
    add("reflect", &[values, normals], |_, v| Ok(reflect(v[0], v[1])?));
    add("srgb_encode", &[base], |_, v| Ok(srgb_encode(v[0])?));
    add("srgb_decode", &[base], |_, v| Ok(srgb_decode(v[0])?));
    add("rasterize", &[clip], |scene, v| {
        let options = RasterOptions::from(scene.size);
        Ok(rasterize(v[0], &scene.mesh, options)?.barycentrics)
    });
    add("rasterize, the layer behind", &[clip], |scene, v| {
        let options = RasterOptions::from(scene.size);
        let front = rasterize(v[0].detach(), &scene.mesh, options)?;
        let front = Fragments { clip: v[0], ..front };
        Ok(rasterize_behind(&front, options)?.barycentrics)
    });
    add("differentials", &[clip], |scene, v| {
        let options = RasterOptions::from(scene.size);
        Ok(differentials(&rasterize(v[0], &scene.mesh, options)?)?)
    });
    add("interpolate_differentials", &[colors, slopes, clip], |scene, v| {
        Ok(interpolate_differentials(v[0], &fragments(scene, v[2], None)?, v[1])?)
    });
    let [texels, places, footprints] = &inputs.texture;
    let texture = [texels, places, footprints];
    add("mipmaps", &[texels], |_, v| {
        let texture = Texture::with_mipmaps(v[0])?;
        Ok(texture.levels()[texture.levels().len() - 1])
    });
    add("sample_texture, a single level", &[texels, places], |_, v| {
        let texture = Texture::new(v[0])?;
        Ok(sample_texture(&texture, v[1], Detail::Finest, Sampler::new())?)
    });
    add("sample_texture, nearest", &texture, |_, v| textured(v, TextureFilter::Nearest));
    add("sample_texture, bilinear", &texture, |_, v| textured(v, TextureFilter::Bilinear));
    add("sample_texture, trilinear", &texture, |_, v| textured(v, TextureFilter::Trilinear));
    add("sample_texture, 4 probes", &texture, |_, v| {
        textured(v, TextureFilter::Anisotropic { probes: 4 })
    });
    let [sides, directions, levels] = &inputs.cube;
    add("sample_cube_map", &[sides, directions, levels], |_, v| {
        let map = CubeMap::with_mipmaps(v[0])?;
        Ok(sample_cube_map(&map, v[1], Detail::Level(v[2]), Sampler::new())?)
    });
    add("interpolate", &[colors, barycentrics, clip], |scene, v| {
        Ok(interpolate(v[0], &fragments(scene, v[2], Some(v[1]))?)?)
    });
    add("image", &[surface, clip], |scene, v| {
        Ok(composite(v[0], &fragments(scene, v[1], None)?, Background::Zero)?.image()?)
    });
    add("composite_layers", &[surface, &inputs.alphas, clip], |scene, v| {
        let all = depth_layers(v[2].detach(), &scene.mesh, scene.size, Some(2))?;
        let mut layers = Vec::with_capacity(all.len());
        for fragments in &all {
            // The layer behind has no more fragments.
            let rows = 0..fragments.coverage.count();
            let premultiplied = v[0].slice(0, rows.clone())?;
            layers.push(Layer { fragments, premultiplied, alpha: v[1].slice(0, rows)? });
        }
        Ok(composite_layers(&layers, Background::Zero)?.values())
    });
    add("over", &[image, aliased], |_, v| Ok(over(v[0], v[1])?));
    add("antialias", &[surface, clip], |scene, v| {
        let picture = composite(v[0], &fragments(scene, v[1], None)?, Background::Zero)?;
        Ok(antialias(picture)?.values())
    });
    add("depth", &[clip], |scene, v| {
        let options = RasterOptions::from(scene.size);
        Ok(depth(&rasterize(v[0], &scene.mesh, options)?)?)
    });
    add("eye_depth", &[clip], |scene, v| {
        let options = RasterOptions::from(scene.size);
        Ok(eye_depth(&rasterize(v[0], &scene.mesh, options)?)?.values())
    });
    let lens = [Tensor::scalar(2.0), Tensor::scalar(1.25)];
    add("depth_of_field", &[image, &inputs.distances, &lens[0], &lens[1]], |_, v| {
        let (lens, distances) =
            (Lens { aperture: v[2], focus: v[3] }, DepthImage::of_distances(v[1]));
        Ok(depth_of_field(v[0], distances, lens, &LensOptions::default())?.image)
    });
    add("gaussian_blur", &[image, &Tensor::scalar(2.0)], |_, v| {
        Ok(gaussian_blur(v[0], v[1], &Blur::default())?)
    });
    add("downsample, box", &[image], |_, v| Ok(downsample(v[0], 4, &Filter::Box, Border::Mirror)?));
    add("downsample, Lanczos", &[image], |_, v| {
        Ok(downsample(v[0], 4, &Filter::Lanczos(3), Border::Mirror)?)
    });
    add("squared_error", &[image, aliased], |_, v| Ok(squared_error(v[0], v[1])?));
    add("mean_absolute_error", &[image, aliased], |_, v| {
        Ok(mean_error(v[0], v[1], Penalty::Absolute)?)
    });
    add("ssim_error", &[image, aliased], |_, v| Ok(ssim_error(v[0], v[1], 1.0)?));
    add("silhouette_error", &[image, aliased], |_, v| Ok(silhouette_error(v[0], v[1])?));
    add("depth_error", &[&inputs.distances, &inputs.other_distances], |_, v| {
        Ok(depth_error(v[0], v[1], None, DepthAlignment::ScaleAndShift)?)
    });
    add("halved", &[image], |_, v| Ok(halved(v[0])?));
    add("total_variation", &[image], |_, v| Ok(total_variation(v[0], 0.0)?));
    add("edge_length_error", &[positions], |scene, v| {
        Ok(edge_length_error(v[0], &topology(scene)?, 0.125)?)
    });
    add("normal_error", &[positions], |scene, v| Ok(normal_error(v[0], &topology(scene)?)?));
    add("rigidity", &[positions], |scene, v| {
        let rest = v[0].value().map(|x| x + T::from_f64(0.125) * x * x);
        let rigidity = Rigidity::new(&topology(scene)?, &rest, RigidWeights::Cotangent)?;
        Ok(rigidity.error(v[0])?)
    });
    add("squared_error, a picture", &[surface, clip, aliased], |scene, v| {
        let picture = composite(v[0], &fragments(scene, v[1], None)?, Background::Zero)?;
        let reference = Reference::new(
            &v[2].value().map(|entry| entry + T::from_f64(0.125)),
            &Tensor::zeros([3]),
        )?;
        Ok(picture.squared_error(&reference)?)
    });
    add("add", &[signed, positive], |_, v| Ok(v[0].try_add(v[1])?));
    add("sub", &[signed, positive], |_, v| Ok(v[0].try_sub(v[1])?));
    add("mul", &[signed, positive], |_, v| Ok(v[0].try_mul(v[1])?));
    add("div", &[signed, positive], |_, v| Ok(v[0].try_div(v[1])?));
    add("pow", &[positive, signed], |_, v| Ok(v[0].pow(v[1])?));
    add("select", &[signed, positive], |_, v| {
        Ok(Mask::from_flat_fn(v[0].shape(), |k| k % 3 > 0).select(v[0], v[1])?)
    });
    add("minimum", &[signed, positive], |_, v| Ok(v[0].minimum(v[1])?));
    add("maximum", &[signed, positive], |_, v| Ok(v[0].maximum(v[1])?));
    add("affine", &[signed], |_, v| Ok(v[0].affine(T::from_f64(0.7), T::from_f64(0.1))));
    add("exp", &[signed], |_, v| Ok(v[0].exp()));
    add("ln", &[positive], |_, v| Ok(v[0].ln()));
    add("sqrt", &[positive], |_, v| Ok(v[0].sqrt()));
    add("powi", &[signed], |_, v| Ok(v[0].powi(3)));
    add("powf", &[positive], |_, v| Ok(v[0].powf(T::from_f64(2.25))));
    add("sin", &[signed], |_, v| Ok(v[0].sin()));
    add("cos", &[signed], |_, v| Ok(v[0].cos()));
    add("tanh", &[signed], |_, v| Ok(v[0].tanh()));
    add("sigmoid", &[signed], |_, v| Ok(v[0].sigmoid()));
    add("softplus", &[signed], |_, v| Ok(v[0].softplus()));
    add("relu", &[signed], |_, v| Ok(v[0].relu()));
    add("abs", &[signed], |_, v| Ok(v[0].abs()));
    add("clamp", &[signed], |_, v| Ok(v[0].clamp(-T::ONE, T::ONE)?));
    add("sum", &[positive], |_, v| Ok(v[0].sum()));
    add("mean", &[positive], |_, v| Ok(v[0].mean()?));
    add("sum_over", &[positive], |_, v| {
        let tape = v[0].tape();
        tape.sum_over(4, &v[..1], |k, _, part| {
            Ok::<_, FitError>(part[0].slice(1, 4 * k..4 * (k + 1))?.square().sum())
        })
    });
    add("cumulative_sum", &[positive], |_, v| Ok(v[0].cumulative_sum(0)?));
    add("dot", &[signed, positive], |_, v| Ok(v[0].dot(v[1], 1)?));
    let [left, right] = &inputs.vectors;
    add("dot, three and a row", &[left, &inputs.row], |_, v| Ok(v[0].dot(v[1], 1)?));
    add("cross", &[left, right], |_, v| Ok(v[0].cross(v[1], 1)?));
    add("norm", &[left], |_, v| Ok(v[0].norm(1)?));
    add("normalize", &[left], |_, v| Ok(v[0].normalize(1)?));
    add("sparse_product", &[left], |_, v| {
        // Each row beside the next five of a ring.
        let rows = v[0].shape()[0];
        let entry = |k: usize| ((k / 5) as u32, ((k / 5 + k % 5) % rows) as u32, T::ONE);
        Ok(SparseMatrix::new(rows, rows, (0..5 * rows).map(entry))?.product(v[0])?)
    });
    add("matmul", &[signed, &inputs.square], |_, v| Ok(v[0].matmul(v[1])?));
    add("permute", &[signed], |_, v| Ok(v[0].permute(&[1, 0])?));
    add("reshape", &[signed], |_, v| Ok(v[0].reshape([v[0].shape().size()])?));
    add("keepdim", &[signed], |_, v| Ok(v[0].keepdim(1)?));
    add("slice", &[signed], |_, v| Ok(v[0].slice(1, 1..WIDTH - 1)?));
    add("pad", &[signed], |_, v| Ok(v[0].pad(1, [2, 2], Padding::Mirror)?));
    add("stack", &[signed, positive], |_, v| Ok(Var::stack(&[v[0], v[1]], 1)?));
    add("concat", &[signed, positive], |_, v| Ok(Var::concat(&[v[0], v[1]], 0)?));
    add("gather_rows", &[signed], |_, v| {
        let rows = v[0].shape()[0] as u32;
        let reversed: Arc<[u32]> = (0..rows).rev().collect();
        Ok(v[0].gather_rows(&reversed)?)
    });
    add("scatter_add_rows", &[signed], |_, v| {
        // Six rows to a sum, as faces meet in a vertex.
        let (rows, count) = (v[0].shape()[0], v[0].shape()[0] / 6 + 1);
        let spread: Arc<[u32]> = (0..rows).map(|row| (row * 7919 % count) as u32).collect();
        Ok(v[0].scatter_add_rows(&spread, count)?)
    });
    all
}

/// What the operations are run on, every number exact in f32.
struct Inputs {
    scene: Scene,
    positions: Tensor<f64>,
    /// `[V, 3]` and `[V, 2]`.
    normals: Tensor<f64>,
    coordinates: Tensor<f64>,
    /// Normals, tangents and map values, one for each pixel.
    frames: [Tensor<f64>; 3],
    /// Base colours, roughness and metallic, one for each pixel; and the strength of a light.
    material: [Tensor<f64>; 4],
    clip: Tensor<f64>,
    barycentrics: Tensor<f64>,
    colors: Tensor<f64>,
    surface: Tensor<f64>,
    /// `[N, 2, 2]`, the differentials of the barycentrics.
    slopes: Tensor<f64>,
    /// `[N]`, one for each fragment.
    alphas: Tensor<f64>,
    /// Texels, coordinates of pixels on a wall that leans back, and their differentials.
    texture: [Tensor<f64>; 3],
    /// The texels of a cube map; a direction and a level for each pixel.
    cube: [Tensor<f64>; 3],
    aliased: Tensor<f64>,
    image: Tensor<f64>,
    /// `[H, W]`, entries in [1/2, 2].
    distances: Tensor<f64>,
    other_distances: Tensor<f64>,
    /// `[H W, WIDTH]`, entries in [-2, 2].
    signed: Tensor<f64>,
    /// The same in [1/2, 2].
    positive: Tensor<f64>,
    /// `[WIDTH, WIDTH]`.
    square: Tensor<f64>,
    /// `[n, 3]`, with at least as many entries, in [-2, 2].
    vectors: [Tensor<f64>; 2],
    /// `[3]`.
    row: Tensor<f64>,
    /// `[4, 4]`, a motion and a scale.
    affine: Tensor<f64>,
    /// `[8, 4, 4]`, the same with other translations.
    instances: Tensor<f64>,
}

/// An affine matrix.
const AFFINE: [f64; 16] =
    [0.5, -0.25, 0.125, 1.0, 0.25, 0.75, 0.5, -2.0, -0.5, 0.25, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0];

/// The second extent of the tensors.
const WIDTH: usize = 16;

impl Inputs {
    fn new(pixels: usize) -> Result<Self, FitError> {
        let scene = Scene::sphere("sphere", 32, 17, pixels)?;
        let mut generator = ChaCha8Rng::seed_from_u64(0);
        let mut uniform = move |low: f64, high: f64| {
            let share = f64::from(generator.next_u32() >> 8) / 16_777_216.0;
            f64::from((low + (high - low) * share) as f32)
        };
        let single = |tensor: Tensor<f32>| tensor.cast();
        let tape = Tape::new();
        let (positions, colors) = (scene.positions.cast(), scene.colors.cast());
        let (at, tinted) = (tape.constant(&positions), tape.constant(&colors));
        let drawn = drawn(&scene, scene.size.into(), at, tinted)?;
        let image = antialias(drawn.composite.clone())?.image()?;
        let rows = pixels * pixels / WIDTH;
        let normals = vertex_normals(at, &scene.mesh, Weighting::Angle)?;
        let vertices = scene.mesh.vertex_count();
        let coordinate = |k: usize| positions.data()[k / 2 * 3 + k % 2];
        let coordinates = Tensor::from_flat_fn([vertices, 2], coordinate);
        let mut vectors =
            |width| Tensor::from_flat_fn([pixels * pixels, width], |_| uniform(-1.0, 1.0));
        let frames = [vectors(3), vectors(4), vectors(3)];
        let directions = vectors(3);
        let count = drawn.fragments.coverage.count();
        Ok(Self {
            slopes: single(differentials(&drawn.fragments)?.value()),
            alphas: Tensor::from_flat_fn([count], |_| uniform(0.0, 1.0)),
            texture: wall(pixels, &mut uniform),
            cube: [
                Tensor::from_flat_fn([6, pixels / 4, pixels / 4, 3], |_| uniform(0.0, 1.0)),
                directions,
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.0, 2.0)),
            ],
            normals: single(normals.value()),
            coordinates: single(coordinates),
            frames,
            material: [
                Tensor::from_flat_fn([pixels * pixels, 3], |_| uniform(0.0, 1.0)),
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.05, 1.0)),
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.0, 1.0)),
                Tensor::from([1.0, 2.0, 3.0]),
            ],
            positions: single(positions),
            clip: single(drawn.clip.value()),
            barycentrics: single(drawn.fragments.barycentrics.value()),
            colors: single(colors),
            surface: single(drawn.surface.value()),
            aliased: single(drawn.composite.image()?.value()),
            image: single(image.value()),
            distances: Tensor::from_flat_fn([pixels, pixels], |_| uniform(0.5, 2.0)),
            other_distances: Tensor::from_flat_fn([pixels, pixels], |_| uniform(0.5, 2.0)),
            signed: Tensor::from_flat_fn([rows, WIDTH], |_| uniform(-2.0, 2.0)),
            positive: Tensor::from_flat_fn([rows, WIDTH], |_| uniform(0.5, 2.0)),
            square: Tensor::from_flat_fn([WIDTH, WIDTH], |_| uniform(-1.0, 1.0)),
            vectors: [(); 2].map(|()| {
                let rows = (pixels * pixels).div_ceil(3);
                Tensor::from_flat_fn([rows, 3], |_| uniform(-2.0, 2.0))
            }),
            row: Tensor::from_flat_fn([3], |_| uniform(-1.0, 1.0)),
            affine: Tensor::from_flat_fn([4, 4], |k| AFFINE[k]),
            instances: Tensor::from_flat_fn([8, 4, 4], |k| match k % 16 {
                3 => (k / 16) as f64,
                entry => AFFINE[entry],
            }),
            scene,
        })
    }
}

/// Texels `[S, S, 3]` for as many pixels, and what each pixel of a wall sees of them: coordinates, and
/// how they change from pixel to pixel. Footprints are one to four texels wide, and two to three times
/// as long.
pub(super) fn wall(pixels: usize, mut uniform: impl FnMut(f64, f64) -> f64) -> [Tensor<f64>; 3] {
    let single = |x: f64| f64::from(x as f32);
    let extent = pixels as f64;
    let at = |k: usize| [(k % pixels) as f64 / extent, (k / pixels) as f64 / extent];
    let texels = Tensor::from_flat_fn([pixels, pixels, 3], |_| uniform(0.0, 1.0));
    let places = Tensor::from_fn([pixels * pixels, 2], |[k, c]| {
        let [x, y] = at(k);
        single([(0.8 + y) * (x - 0.3), 2.0 * y * (1.0 + y) + 0.3 * x][c])
    });
    let footprints = Tensor::from_fn([pixels * pixels, 2, 2], |[k, c, axis]| {
        let [x, y] = at(k);
        let slope = [[0.8 + y, x - 0.3], [0.3, 2.0 + 4.0 * y]][c][axis];
        single(slope / extent)
    });
    [texels, places, footprints]
}

/// A case in one precision, with its memory.
pub(super) struct Runner<T: Scalar> {
    case: Case<T>,
    inputs: Vec<Tensor<T>>,
    /// Starts as ones; set once the shape of the output is known.
    upstream: Option<Tensor<T>>,
    tape: Tape<T>,
}

impl<T: Scalar> Runner<T> {
    pub(super) fn new(case: Case<T>) -> Self {
        let inputs = case.inputs.iter().map(Tensor::cast).collect();
        let tape = Tape::new();
        tape.set_timed(true);
        Self { case, inputs, upstream: None, tape }
    }

    /// Records and walks back once: the seconds of either pass, and of all that a step does.
    pub(super) fn step(&mut self, scene: &Scene) -> Result<([f64; 2], f64), FitError> {
        let start = Instant::now();
        {
            let inputs: Vec<Var<'_, T>> =
                self.inputs.iter().map(|input| self.tape.leaf(input)).collect();
            let output = (self.case.record)(scene, &inputs)?;
            let upstream = self.upstream.as_ref().expect("it ran before");
            black_box(self.tape.vjp(&[(output, upstream)])?);
        }
        self.tape.reset();
        let seconds = start.elapsed().as_secs_f64();
        Ok((self.passes(), seconds))
    }

    /// The seconds of forward and of backward passes since the last report.
    fn passes(&mut self) -> [f64; 2] {
        let report = self.tape.take_report();
        let own = || report.operations.iter().filter(|entry| self.case.has(entry.name));
        let forward = own().map(|entry| entry.forward.as_secs_f64()).sum();
        [forward, own().map(|entry| entry.backward.as_secs_f64()).sum()]
    }

    /// Records and walks back once: the output and the gradients, and the seconds of either pass.
    pub(super) fn run(&mut self, scene: &Scene) -> Result<(Vec<Tensor<T>>, [f64; 2]), FitError> {
        let results = {
            let inputs: Vec<Var<'_, T>> =
                self.inputs.iter().map(|input| self.tape.leaf(input)).collect();
            let output = (self.case.record)(scene, &inputs)?;
            // Between 1/2 and 3/2, and exact in f32.
            let entry = |k: usize| T::from_f64(0.5 + (k % 257) as f64 / 256.0);
            let upstream =
                self.upstream.get_or_insert_with(|| Tensor::from_flat_fn(output.shape(), entry));
            let gradients = self.tape.vjp(&[(output, upstream)])?;
            let all = inputs.iter().map(|&input| gradients.get_or_zeros(input));
            std::iter::once(output.value()).chain(all).collect()
        };
        let seconds = self.passes();
        self.tape.reset();
        Ok((results, seconds))
    }
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let pixels = bench.effort.choose(32, 256);
    let samples = bench.effort.samples(1e-3, USUAL);
    let mut study = Study::new(
        "operations",
        "Every operation in f32 and in f64",
        format!(
            "Forward and backward to every input, one thread, by the tape's own clock; samples in \
             turns, {samples} of each. Rendering operations on a sphere of 1024 faces in {pixels} x \
             {pixels} pixels, tensor operations on {} entries; nanoseconds are per pixel and per \
             entry, the larger of inputs and output. Errors are f32's against f64 on the same \
             inputs, as a share of the largest entry: of the output, and of the worst gradient.",
            pixels * pixels
        ),
    );
    let mut table = Table::new(
        "operations",
        "Time and error",
        &[
            ("operation", "operation"),
            ("f32, ns", "f32_minimum_nanoseconds"),
            ("median", "f32_median_nanoseconds"),
            ("f64, ns", "f64_minimum_nanoseconds"),
            ("median", "f64_median_nanoseconds"),
            ("f64 / f32", "ratio"),
            ("error of the output", "output_error"),
            ("of a gradient", "gradient_error"),
        ],
    );
    let inputs = Inputs::new(pixels)?;
    let scene = &inputs.scene;
    for (single, double) in cases::<f32>(&inputs).into_iter().zip(cases::<f64>(&inputs)) {
        let (label, name) = (single.label, single.name());
        let (mut single, mut double) = (Runner::new(single), Runner::new(double));
        let mut sample = || {
            let mut errors = [0.0_f64; 2];
            let mut seconds = [Vec::new(), Vec::new()];
            let mut entries = 0;
            for round in 0..=samples {
                let (found, of_single) = single.run(scene)?;
                let (exact, of_double) = double.run(scene)?;
                if round == 0 {
                    // The first run warms up, and has the same results as all others.
                    entries = exact.iter().map(Tensor::size).max().unwrap_or(1);
                    for (at, (found, exact)) in found.iter().zip(&exact).enumerate() {
                        let error = &mut errors[at.min(1)];
                        *error = error.max(relative_error(found, exact));
                    }
                    continue;
                }
                seconds[0].push(of_single.iter().sum());
                seconds[1].push(of_double.iter().sum());
            }
            Ok((errors, seconds, entries))
        };
        let Some((errors, seconds, entries)) = study.noted(label, bench.one().install(&mut sample))
        else {
            continue;
        };
        let [single, double] = seconds.map(Timing::of);
        let is_tensor = inputs.signed.size() <= entries && !RENDERING.contains(&name);
        let count = if is_tensor { entries } else { pixels * pixels } as f64;
        table.push(vec![
            Cell::text(label),
            Cell::timed(&single, 1e9 * single.minimum / count),
            Cell::timed(&single, 1e9 * single.median / count),
            Cell::timed(&double, 1e9 * double.minimum / count),
            Cell::timed(&double, 1e9 * double.median / count),
            Cell::number(double.minimum / single.minimum),
            Cell::number(errors[0]),
            Cell::number(errors[1]),
        ]);
    }
    study.tables.push(table);
    Ok(study)
}

/// The operations whose times are per pixel.
const RENDERING: [&str; 26] = [
    "shade",
    "irradiance",
    "reflect",
    "downsample",
    "tangents",
    "perturbed_normals",
    "transform_normals",
    "project",
    "face_normals",
    "vertex_normals",
    "rasterize",
    "interpolate",
    "image",
    "antialias",
    "depth",
    "depth_of_field",
    "gaussian_blur",
    "squared_error",
    "composite_layers",
    "over",
    "differentials",
    "interpolate_differentials",
    "mipmaps",
    "sample_texture",
    "sample_cube_map",
    "depth_error",
];

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    #[test]
    fn no_operation_is_missing() {
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let exports = fs::read_to_string(crates.join("render-ops/src/lib.rs")).unwrap();
        // Lists of names go over several lines.
        let exports = exports.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next());
        let exported = exports.flat_map(|path| {
            let names = path.split("::").last().unwrap_or_default();
            names
                .split(',')
                .map(|name| name.trim_matches(|c: char| "{}".contains(c) || c.is_whitespace()))
        });
        // `interpolate_indexed` and `interpolate_differentials_indexed` record what those without an
        // index buffer do, `rasterize_behind` and `depth_layers` what `rasterize` does, `composite`
        // nothing at pixel centres, `exposure` an exponential and a product.
        let others = [
            "interpolate_indexed",
            "interpolate_differentials_indexed",
            "rasterize_behind",
            "depth_layers",
            "composite",
            "exposure",
            "glam",
        ];
        let is_operation = |name: &&str| {
            name.starts_with(|c: char| c.is_ascii_lowercase()) && !others.contains(name)
        };
        let of_core = fs::read_dir(crates.join("core/src/ops")).unwrap();
        let of_core = of_core
            .map(|file| file.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned());
        let mut expected: Vec<_> = exported.filter(is_operation).map(str::to_owned).collect();
        expected.extend(of_core.filter(|name| name != "mod"));
        // What is no function of its own.
        expected.extend(["mipmaps", "sum_over", "image", "squared_error"].map(str::to_owned));
        assert!(expected.len() > 70, "{expected:?}");
        assert!(expected.iter().any(|name| name == "sample_texture"), "{expected:?}");
        let cases = cases::<f32>(&Inputs::new(32).unwrap());
        for name in expected {
            assert!(cases.iter().any(|case| case.name() == name), "{name} is missing");
        }
    }

    #[test]
    fn every_operation_is_on_the_tape_under_its_name_and_is_walked_back() {
        let inputs = Inputs::new(32).unwrap();
        for case in cases::<f32>(&inputs) {
            let name = case.name();
            let runner = Runner::new(case);
            let given: Vec<_> = runner.inputs.iter().map(|input| runner.tape.leaf(input)).collect();
            let output = (runner.case.record)(&inputs.scene, &given).unwrap();
            let upstream = Tensor::full(output.shape(), 1.0);
            runner.tape.vjp(&[(output, &upstream)]).unwrap();
            let report = runner.tape.take_report();
            let own = report.operations.iter().find(|entry| entry.name == name);
            let own = own.unwrap_or_else(|| panic!("{name} is not in {report}"));
            assert!(own.calls > 0 && own.backward_calls > 0, "{report}");
        }
    }
}
