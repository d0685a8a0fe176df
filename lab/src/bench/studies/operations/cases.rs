//! The list of operations.

use std::sync::Arc;

use bokashi_core::{Mask, Padding, Scalar, SparseMatrix, Tensor, Var};
use bokashi_fit::{
    DepthAlignment, FitError, Penalty, RigidWeights, Rigidity, Topology, depth_error,
    edge_length_error, halved, mean_error, normal_error, silhouette_error, squared_error,
    ssim_error, total_variation,
};
use bokashi_render_ops::{
    Background, Blur, Border, CubeMap, DepthImage, Detail, Filter, Fragments, Layer, Lens,
    LensOptions, Light, Material, PixelLoss, RasterOptions, Sampler, Surface, Texture,
    TextureFilter, Weighting, affine_inverse, antialias, composite, composite_layers, depth,
    depth_layers, depth_of_field, differentials, distort, downsample, eye_depth, face_normals,
    fisheye, gaussian_blur, interpolate, interpolate_differentials, irradiance, orthographic, over,
    perturbed_normals, pinhole, project, project_instances, rasterize, rasterize_behind, reflect,
    rigid, sample_cube_map, sample_texture, se3, shade, srgb_decode, srgb_encode, tangents,
    transform_normals, transform_points, vertex_normals,
};

use super::inputs::{Inputs, WIDTH};
use crate::bench::operation::{Case, Record};
use crate::bench::scenes::Scene;

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
pub(crate) fn metal<'t, T: Scalar>(v: &[Var<'t, T>], conserves_energy: bool) -> Material<'t, T> {
    let (base_color, roughness, metallic) = (v[2], v[3], v[4]);
    Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy }
}

/// A surface with the normals and views of the inputs 0 and 1; its positions are the views.
pub(crate) fn shaded<'t, T: Scalar>(
    v: &[Var<'t, T>],
    material: Material<'t, T>,
    light: Light<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let surface = Surface { normals: v[0], views: v[1], positions: Some(v[1]) };
    Ok(shade(&surface, &material, &[light])?)
}

/// Samples of a texture that was made mipmaps of, by the inputs texels, coordinates and differentials.
pub(crate) fn textured<'t, T: Scalar>(
    v: &[Var<'t, T>],
    filter: TextureFilter,
) -> Result<Var<'t, T>, FitError> {
    let detail = Detail::Differentials { differentials: v[2], bias: None };
    let texture = Texture::with_mipmaps(v[0])?;
    Ok(sample_texture(&texture, v[1], detail, Sampler::new().filter(filter))?)
}

/// Every operation, with entries in numbers like those of a small image.
pub(super) fn cases<T: Scalar>(inputs: &Inputs) -> Vec<Case<T, Scene>> {
    let Inputs { signed, positive, .. } = inputs;
    let mut all: Vec<Case<T, Scene>> = Vec::new();
    let mut add = |label, given: &[&Tensor<f64>], record: Record<T, Scene>| {
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
    let angles = Tensor::from([0.0625, -0.015625, 0.00390625, -0.0009765625]);
    add("fisheye", &[positions, &angles], |_, v| Ok(fisheye(v[0], v[1])?));
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
            (Lens { aperture: v[2], focus: v[3] }, DepthImage::from_distances(v[1]));
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
    add("total_variation", &[image], |_, v| Ok(total_variation(v[0], Penalty::Absolute)?));
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
        let reference = PixelLoss::squared(
            &v[2].value().map(|entry| entry + T::from_f64(0.125)),
            &Tensor::zeros([3]),
        )?;
        Ok(picture.loss(&reference)?)
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
    add("dot", &[signed, positive], |_, v| Ok(v[0].dot(v[1])?));
    let [left, right] = &inputs.vectors;
    add("dot, three and a row", &[left, &inputs.row], |_, v| Ok(v[0].dot(v[1])?));
    add("cross", &[left, right], |_, v| Ok(v[0].cross(v[1])?));
    add("norm", &[left], |_, v| Ok(v[0].norm()?));
    add("normalize", &[left], |_, v| Ok(v[0].normalize()?));
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
