//! Rendering operations that are compiled ahead: see `bokashi_core::precompiled`. Nobody calls these functions.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use glam::DMat4;

use crate::antialias::antialias;
use crate::background::Background;
use crate::border::Border;
use crate::camera::{affine_inverse, distort, fisheye, orthographic, pinhole, rigid, se3};
use crate::composite::composite;
use crate::depth::depth;
use crate::depth_of_field::{Lens, LensOptions, depth_of_field};
use crate::differentials::differentials;
use crate::downsample::downsample;
use crate::environment::{Environment, Prefilter};
use crate::error::RenderError;
use crate::eye_depth::eye_depth;
use crate::face_normals::face_normals;
use crate::filter::Filter;
use crate::gaussian_blur::gaussian_blur;
use crate::interpolate::interpolate;
use crate::interpolate_differentials::interpolate_differentials;
use crate::lens::{LensLayer, ThinLens, ThinLensOptions, lens_picture};
use crate::mesh::Mesh;
use crate::perturbed_normals::perturbed_normals;
use crate::pixel_loss::PixelLoss;
use crate::project::{Pose, project};
use crate::rasterize::rasterize;
use crate::reflect::reflect;
use crate::shading::{Light, Material, Surface, shade};
use crate::size::Size;
use crate::srgb::{exposure, srgb_decode, srgb_encode};
use crate::tangents::tangents;
use crate::taps::Blur;
use crate::texture::{CubeMap, Detail, Sampler, Texture, sample_cube_map, sample_texture};
use crate::transform_normals::transform_normals;
use crate::transform_points::transform_points;
use crate::vertex_normals::{Weighting, vertex_normals};

#[cfg(feature = "precompiled-f64")]
use crate::{
    antialias::antialias_image,
    composite_layers::{Layer, composite_layers},
    over::over,
    project_instances::project_instances,
};

macro_rules! for_each_precision {
    ($($name:ident: $operations:ident in $t:ty),*) => {
        $(pub fn $name(tape: &Tape<$t>) -> Result<(), RenderError> {
            $operations(tape.constant(&Tensor::zeros([])))
        })*
    };
}

for_each_precision!(f32_operations: operations_of_the_program in f32);
#[cfg(feature = "precompiled-f64")]
for_each_precision!(
    f32_others: other_operations in f32,
    f64_operations: operations_of_the_program in f64,
    f64_others: other_operations in f64
);

/// What fits of the cube and reports do in `f64`, too.
pub fn f64_picture(tape: &Tape<f64>) -> Result<(), RenderError> {
    let x = tape.constant(&Tensor::zeros([]));
    let mesh = Mesh::new(Vec::new(), 0)?;
    let clip = project(x, &DMat4::IDENTITY, None)?;
    let fragments = rasterize(clip, &mesh, Size::square(1))?;
    let picture = antialias(composite(interpolate(x, &fragments)?, &fragments, Background::Zero)?)?;
    let loss = PixelLoss::squared(&x.value(), &x.value())?;
    picture.loss(&loss)?;
    let sigma = gaussian_blur(picture.image()?, x, &Blur::default())?;
    let blurred = picture.blurred(sigma, &Blur::default());
    blurred.loss(&loss)?;
    blurred.image()?;
    Ok(())
}

/// In one piece: a list of calls.
fn operations_of_the_program<T: Scalar>(x: Var<'_, T>) -> Result<(), RenderError> {
    let mesh = Mesh::new(Vec::new(), 0)?;
    let intrinsics =
        pinhole(x, Size::square(1), 0.1, 1.0)? + orthographic(x, Size::square(1), 0.1, 1.0)?;
    let view = affine_inverse(rigid(x, x)?.matmul(se3(x, &DMat4::IDENTITY)?)?)?;
    let points = fisheye(distort(transform_points(x, view)?, x)?, x)?;
    let pose = Some(Pose { rotation: x, translation: x });
    let clip = project(points, intrinsics, pose)? + project(points, &DMat4::IDENTITY, pose)?;
    let fragments = rasterize(clip, &mesh, Size::square(1))?;
    let slopes = differentials(&fragments)?;
    let values = interpolate(x, &fragments)? + depth(&fragments)?;
    let detail = Detail::Differentials {
        differentials: interpolate_differentials(x, &fragments, slopes)?,
        bias: Some(x),
    };
    let samples = [
        sample_texture(&Texture::with_mipmaps(x)?, x, detail, Sampler::new())?,
        sample_cube_map(&CubeMap::with_mipmaps(x)?, x, detail, Sampler::new())?,
    ];
    let picture =
        antialias(composite(values + samples[0] + samples[1], &fragments, Background::Color(x))?)?;
    let loss = PixelLoss::squared(&x.value(), &x.value())?;
    picture.loss(&loss)?;
    picture.loss(&PixelLoss::new(&x.value(), &x.value(), |x, _| Ok(x))?)?;
    let image = gaussian_blur(picture.image()?, x, &Blur::default())?;
    let blurred = picture.blurred(x, &Blur::default());
    let image = image + blurred.image()? + blurred.loss(&loss)?;
    let distances = eye_depth(&fragments)?.image(&fragments, 1.0)?;
    let lens = Lens { aperture: x, focus: x };
    depth_of_field(image, distances, lens, &LensOptions::default())?;
    let layer = LensLayer::from_fragments(&fragments, x, x)?;
    let lens = ThinLens::from_radius(x, x, x)?;
    lens_picture(layer, &[layer], Background::Zero, 1.0, lens, &ThinLensOptions::default())?;
    downsample(image, 1, &Filter::Mitchell, Border::Mirror)?;
    face_normals(x, &mesh)?;
    let normals = vertex_normals(x, &mesh, Weighting::Area)?;
    let tangents = tangents(x, transform_normals(normals, x)?, x, &mesh, &mesh)?;
    let normals = perturbed_normals(normals, tangents, x)?;
    let surface = Surface { normals, views: reflect(x, normals)?, positions: Some(x) };
    let metal = |conserves_energy| Material::MetallicRoughness {
        base_color: x,
        roughness: x,
        metallic: x,
        conserves_energy,
    };
    let (color, specular, exponent) = (x, x, x);
    let materials = [
        metal(false),
        metal(true),
        Material::Lambert { color },
        Material::Phong { color, specular, exponent },
        Material::BlinnPhong { color, specular, exponent },
    ];
    let environment = Environment::from_texels(x, &Prefilter::new(1, 1)?)?;
    for material in materials {
        let light = shade(&surface, &material, &[Light::Ambient { radiance: x }])?;
        let light = light + environment.shade(&surface, &material)?;
        srgb_encode(exposure(srgb_decode(light)?, x)?)?;
    }
    Ok(())
}

#[cfg(feature = "precompiled-f64")]
fn other_operations<T: Scalar>(x: Var<'_, T>) -> Result<(), RenderError> {
    let clip = project_instances(x, x, x)?;
    let fragments = rasterize(clip, &Mesh::new(Vec::new(), 0)?, Size::square(1))?;
    antialias_image(x, &fragments)?;
    let layer = Layer { fragments: &fragments, premultiplied: over(x, x)?, alpha: x };
    composite_layers(&[layer], Background::Zero)?;
    Ok(())
}
