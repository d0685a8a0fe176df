//! What a fit has learnt, put back into its scene; and a scene's objects as a model for a file.

use std::collections::HashMap;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::Parameters;
use bokashi_render_ops::camera::from_tensor;
use bokashi_render_ops::{RenderError, se3};
use glam::{DMat4, DVec3};

use crate::cameras::NamedView;
use crate::description::{Finite, LensEntry, LightEntry, NotNegative, Positive};
use crate::error::SceneError;
use crate::model::{Geometry, Indexed, MaterialFile, Model, NO_ROW, Placed, Submesh};
use crate::object::{Attribute, Object, SurfaceLook};
use crate::picture::{ColorSpace, Picture, Samples};
use crate::renderer::Renderer;
use crate::scene::Scene;
use crate::values::of_object;

/// The motion about a place by an increment whose translation is in radii of the scene.
pub(crate) fn motion(increment: &[f32], radius: f64, about: DVec3) -> Result<DMat4, RenderError> {
    let tape = Tape::<f64>::new();
    let scaled =
        Tensor::from_flat_fn([6], |k| f64::from(increment[k]) * if k < 3 { radius } else { 1.0 });
    let moved = se3(tape.constant(&scaled), &DMat4::from_translation(-about))?;
    Ok(DMat4::from_translation(about) * from_tensor(&moved.value())?)
}

impl Renderer {
    /// The scene with the values of `parameters` in the place of its own.
    ///
    /// # Errors
    /// Those of a parameter that is no number of the scene: none, where a fit of the scene made them.
    pub(crate) fn with_values(&self, parameters: &Parameters<f32>) -> Result<Scene, SceneError> {
        let mut scene = self.scene().clone();
        let value = |name: &str| parameters.value(name).ok();
        let radius = self.radius();
        for (object, middle) in scene.objects.iter_mut().zip(self.middles()) {
            let own = |kind: &str| value(&of_object(kind, &object.name));
            let (vertices, pose, colors) = (own("vertices"), own("pose"), own("colors"));
            let of_look = |look| {
                ["texture", "roughness", "metallic"]
                    .map(|kind| value(&object.parameter(kind, look)))
            };
            let of_looks: Vec<_> = object.looks.iter().map(of_look).collect();
            if let Some(positions) = vertices {
                object.positions = positions;
                // Those of the file were of the surface as it was.
                object.tangents = None;
            }
            if let Some(pose) = pose {
                let moved = motion(pose.data(), radius, middle)?;
                object.places.iter_mut().for_each(|place| *place = moved * *place);
            }
            if let (Some(rows), Some(colors)) = (colors, &mut object.colors) {
                colors.rows = rows;
            }
            for (look, values) in object.looks.iter_mut().zip(of_looks) {
                look.set(values);
            }
        }
        let cameras = value("cameras");
        let (intrinsics, distortion) = (value("intrinsics"), value("distortion"));
        for (at, view) in scene.views.iter_mut().enumerate() {
            let camera = &mut view.camera;
            if let Some(increments) = &cameras {
                let own = &increments.data()[6 * at..][..6];
                let about = camera.view.transform_point3(self.center());
                camera.view = motion(own, radius, about)? * camera.view;
            }
            if let Some(learnt) = &intrinsics {
                let by = |k: usize| f64::from(learnt.data()[k]);
                let width = camera.size.width as f64;
                let [fx, fy, cx, cy] = camera.intrinsics;
                camera.intrinsics =
                    [fx * by(0).exp(), fy * by(1).exp(), cx + by(2) * width, cy + by(3) * width];
            }
            if let Some(learnt) = &distortion {
                let own: Vec<f64> = learnt.data().iter().map(|&x| x.into()).collect();
                camera.distortion = camera.distortion.with_coefficients(&own);
            }
        }
        for (at, light) in scene.description.lights.iter_mut().enumerate() {
            if let Some(learnt) = value(&of_object("light", &at.to_string())) {
                let own = std::array::from_fn(|k| NotNegative(learnt.data()[k].into()));
                let (LightEntry::Ambient { color }
                | LightEntry::Directional { color, .. }
                | LightEntry::Point { color, .. }) = light;
                *color = own;
            }
        }
        for (at, light) in scene.description.lights.iter_mut().enumerate() {
            let Some(learnt) = value(&of_object("light_place", &at.to_string())) else { continue };
            let own = std::array::from_fn(|k| Finite(learnt.data()[k].into()));
            match light {
                LightEntry::Directional { direction: place, .. }
                | LightEntry::Point { position: place, .. } => *place = own,
                LightEntry::Ambient { .. } => (),
            }
        }
        if let Some(texels) = value("environment") {
            scene.environment = Some(texels);
        }
        let number = |name: &str| value(name).map(|value| f64::from(value.data()[0]));
        let pipeline = &mut scene.description.pipeline;
        pipeline.exposure = number("exposure").map(Finite).or(pipeline.exposure);
        pipeline.blur = number("blur").map(Positive).or(pipeline.blur);
        if let Some(LensEntry { aperture, focus, .. }) = &mut pipeline.lens {
            *aperture = number("aperture").map_or(*aperture, NotNegative);
            *focus = number("focus").map_or(*focus, Positive);
        }
        Ok(scene)
    }
}

impl Scene {
    /// The objects with their materials, for [`glb`](crate::glb), [`obj`](crate::obj()) and [`ply`](crate::ply).
    /// Where vertices are learnt, normals and tangents are left out: whoever shows the mesh makes them of its faces.
    ///
    /// # Errors
    /// None: those of images without pixels.
    pub fn model(&self) -> Result<Model, SceneError> {
        let mut model = Model::default();
        for (at, object) in self.objects.iter().enumerate() {
            // Looks of one name are one material.
            let mut numbers = HashMap::new();
            for look in &object.looks {
                if !numbers.contains_key(look.name.as_str()) {
                    numbers.insert(look.name.as_str(), model.materials.len());
                    let name = if object.looks.len() > 1 { &look.name } else { &object.name };
                    model.materials.push(look.material(name, &mut model.images)?);
                }
            }
            // Those of the file were of the surface as it was.
            let keeps = !self.learns_vertices(object);
            model.geometries.push(object.geometry(&numbers, keeps));
            model.placed.extend(object.places.iter().map(|&transform| Placed {
                name: object.name.clone(),
                geometry: at,
                transform,
            }));
        }
        Ok(model)
    }

    /// The views that have an image, with their cameras, for
    /// [`transforms_json`](crate::transforms_json).
    pub fn cameras(&self) -> Vec<NamedView> {
        let views = self.views.iter().filter_map(|view| {
            let image = view.image.clone()?;
            let (name, mask) = (view.name.clone(), view.mask.clone());
            Some(NamedView { name, image, mask, camera: view.camera })
        });
        views.collect()
    }
}

impl Object {
    /// The geometry; `materials` has the numbers of its looks by name. `keeps_normals` keeps normals and tangents.
    fn geometry(&self, materials: &HashMap<&str, usize>, keeps_normals: bool) -> Geometry {
        let submeshes = self.looks.iter().map(|look| Submesh {
            material: materials.get(look.name.as_str()).copied(),
            faces: look.faces.clone(),
        });
        Geometry {
            name: self.name.clone(),
            positions: rows(&self.positions),
            offset: self.offset,
            faces: self.mesh.faces().to_vec(),
            colors: self.colors.as_ref().map(indexed),
            coordinates: self.coordinates.as_ref().map(indexed),
            normals: self.normals.as_ref().filter(|_| keeps_normals).map(indexed),
            tangents: self.tangents.as_ref().filter(|_| keeps_normals).map(indexed),
            submeshes: submeshes.collect(),
        }
    }
}

impl SurfaceLook {
    /// Takes what was learnt of texture, roughness and metallic.
    fn set(&mut self, [texture, roughness, metallic]: [Option<Tensor<f32>>; 3]) {
        match texture {
            Some(color) if color.shape().len() == 1 => {
                self.base_color = std::array::from_fn(|k| color.data()[k]);
            }
            Some(texels) => self.texture = Some(texels),
            None => (),
        }
        for (channel, map) in [roughness, metallic].into_iter().enumerate() {
            let Some(map) = map else { continue };
            match &self.roughness_metallic {
                Some(own) => {
                    let both = Tensor::from_flat_fn(own.shape(), |k| {
                        if k % 2 == channel { map.data()[k / 2] } else { own.data()[k] }
                    });
                    self.roughness_metallic = Some(both);
                }
                None if channel == 0 => self.roughness = map.data()[0],
                None => self.metallic = map.data()[0],
            }
        }
    }

    fn material(&self, name: &str, images: &mut Vec<Picture>) -> Result<MaterialFile, SceneError> {
        let mut add = |picture: Picture| {
            images.push(picture);
            images.len() - 1
        };
        let color = match &self.texture {
            Some(texels) => Some(add(Picture::of_color(texels, ColorSpace::Srgb)?)),
            None => None,
        };
        let [red, green, blue] = if color.is_some() { [1.0; 3] } else { self.base_color };
        let maps = self.roughness_metallic.as_ref().map(|maps| {
            let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
            let texels = maps.data().chunks_exact(2);
            let samples = texels.flat_map(|own| [0, byte(own[0]), byte(own[1])]).collect();
            let [height, width] = [maps.shape()[0], maps.shape()[1]];
            add(Picture { width, height, channels: 3, samples: Samples::U8(samples) })
        });
        let normals = self.normal_map.as_ref().map(|map| {
            let byte = |x: f32| (127.5 * (x.clamp(-1.0, 1.0) + 1.0)).round() as u8;
            let samples = map.data().iter().map(|&x| byte(x)).collect();
            let [height, width] = [map.shape()[0], map.shape()[1]];
            add(Picture { width, height, channels: 3, samples: Samples::U8(samples) })
        });
        Ok(MaterialFile {
            name: name.to_owned(),
            base_color: [red, green, blue, 1.0],
            base_color_image: color,
            lacks_base_color_image: false,
            base_color_borders: self.texture_borders,
            metallic: if maps.is_some() { 1.0 } else { self.metallic },
            roughness: if maps.is_some() { 1.0 } else { self.roughness },
            metallic_roughness_image: maps,
            metallic_roughness_borders: self.roughness_metallic_borders,
            lacks_metallic_roughness_image: false,
            normal_image: normals,
            normal_borders: self.normal_map_borders,
            normal_scale: 1.0,
        })
    }
}

fn rows<const N: usize>(rows: &Tensor<f32>) -> Vec<[f32; N]> {
    rows.data().chunks_exact(N).map(|row| std::array::from_fn(|k| row[k])).collect()
}

fn indexed<const N: usize>(own: &Attribute) -> Indexed<N> {
    let rows = rows(&own.rows);
    let row = |row: u32| if row as usize == rows.len() { NO_ROW } else { row };
    let faces = own.indices.faces().iter().map(|face| face.map(row)).collect();
    Indexed { rows, faces }
}
