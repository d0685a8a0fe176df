//! The objects of a scene: meshes of files, shapes and hulls, with what the scene says of their materials.

use bokashi_core::Tensor;
use glam::DMat4;
use toml::Spanned;

use super::source::{Source, color_space};
use crate::description::{Description, MaterialEntry, MeshEntry, Shape};
use crate::error::{Location, SceneError};
use crate::file_names::stem;
use crate::hull::{AGREEMENT, hull_of_views};
use crate::memory::{OF_FACE, OF_NEW_TEXEL, OF_POINT, OF_TEXEL};
use crate::mesh::{MeshKind, MeshOptions, read_counted};
use crate::model::{Geometry, Model, Placed, Submesh, covers};
use crate::object::{Object, SurfaceMap, SurfaceMaterial, vectors};
use crate::picture::{ColorSpace, MOST_SAMPLES};
use crate::scene_view::SceneView;
use crate::shapes;

/// Faces of a shape, where a scene does not say.
const FACES: usize = 1280;
/// Likewise of a hull.
const FACES_OF_HULL: usize = 4000;
/// The most faces of a shape.
const MOST_FACES: u64 = 10_000_000;

/// Cells along the longest side of a field's grid, where a scene does not say; and how many times it is smoothed.
const CELLS: usize = 48;
const SMOOTHINGS: usize = 2;

impl Source {
    /// The model of a mesh entry, and what the mesh is called where the entry does not say.
    fn model(
        &self,
        entry: &Spanned<MeshEntry>,
        views: &[SceneView],
        notes: &mut Vec<String>,
    ) -> Result<(Model, String), SceneError> {
        let mesh = entry.get_ref();
        match (&mesh.file, mesh.shape) {
            (Some(file), None) if mesh.faces.is_none() && mesh.agreement.is_none() => {
                let vertex_color_space = mesh.vertex_color_space.map(color_space);
                let options = MeshOptions { vertex_color_space, weld: mesh.weld };
                let model = read_counted(&self.folder, file, options)?;
                let note = |note: &String| format!("{}: {note}", file.display());
                notes.extend(model.notes.iter().map(note));
                Ok((model, stem(file)))
            }
            (None, Some(shape)) if mesh.vertex_color_space.is_none() && mesh.weld.is_none() => {
                let faces = mesh.faces.map_or(FACES, |faces| faces.0);
                self.at_most(entry, "faces of a shape", MOST_FACES, faces as u64)?;
                let what = || format!("a shape of {faces} faces");
                self.folder.memory().check(faces as u64 * OF_FACE, &self.location(entry), what)?;
                if mesh.agreement.is_some() && shape != Shape::Hull {
                    return Err(self.wrong(entry, "`agreement` is that of a hull"));
                }
                let geometry = match shape {
                    Shape::Hull => self.hull(entry, views)?,
                    Shape::Sphere => shapes::sphere(faces),
                    Shape::Cube => shapes::cube(mesh.faces.map_or(12, |faces| faces.0)),
                    Shape::Plane => shapes::plane(mesh.faces.map_or(2, |faces| faces.0)),
                };
                let name = geometry.name.clone();
                let transform = DMat4::from_translation(geometry.offset);
                let placed = Placed { name: name.clone(), geometry: 0, transform };
                let model =
                    Model { geometries: vec![geometry], placed: vec![placed], ..Model::default() };
                Ok((model, name))
            }
            _ => {
                let rule = "a mesh has either `file`, perhaps with `vertex_color_space` and `weld`, or `shape`, \
                            perhaps with `faces` and `agreement`";
                Err(self.wrong(entry, rule))
            }
        }
    }

    /// The hull of a mesh entry.
    fn hull(
        &self,
        entry: &Spanned<MeshEntry>,
        views: &[SceneView],
    ) -> Result<Geometry, SceneError> {
        let mesh = entry.get_ref();
        let agreement = mesh.agreement.map_or(AGREEMENT, |share| share.0);
        let faces = mesh.faces.map_or(FACES_OF_HULL, |faces| faces.0);
        let geometry = hull_of_views(&self.folder, views, faces, agreement)?;
        geometry.map_err(|rule| self.wrong(entry, rule))
    }

    /// The objects of a mesh entry: a file may hold several.
    pub(super) fn objects(
        &self,
        entry: &Spanned<MeshEntry>,
        views: &[SceneView],
        is_lit: bool,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Object>, SceneError> {
        let mesh = entry.get_ref();
        let (model, default) = self.model(entry, views, notes)?;
        let is_gltf = mesh.file.as_ref().and_then(|file| MeshKind::from_path(file).ok())
            == Some(MeshKind::Gltf);
        let name = mesh.name.clone().unwrap_or(default);
        let first = mesh.place.matrix();
        let mut instances = vec![first];
        instances.extend(mesh.instances.iter().map(|instance| first * instance.matrix()));
        let places = model.places().into_iter().enumerate();
        let drawn: Vec<_> = places.filter(|(_, places)| !places.is_empty()).collect();
        let mut objects = Vec::with_capacity(drawn.len());
        for (index, (k, places)) in drawn.iter().enumerate() {
            // Several meshes of a file: bunny-1, bunny-2.
            let name =
                if drawn.len() == 1 { name.clone() } else { format!("{name}-{}", index + 1) };
            let places =
                instances.iter().flat_map(|&m| places.iter().map(move |&transform| m * transform));
            let geometry = &model.geometries[*k];
            let materials = geometry.materials().flatten().filter_map(|k| model.materials.get(k));
            let texels = materials.map(|k| SurfaceMaterial::texels_of_file(k, &model.images)).sum();
            self.claim_texels(texels, entry)?;
            for submesh in &geometry.submeshes {
                let material = submesh.material.and_then(|k| model.materials.get(k));
                let is_mapped = material.is_some_and(|material| material.images().next().is_some());
                if is_mapped && !covers(&geometry.coordinates, &submesh.faces) {
                    let rule = "images of its material were left out";
                    notes.push(format!("{name}: {rule}, as it has no texture coordinates"));
                }
            }
            let has_normals = |k: &Submesh| covers(&geometry.normals, &k.faces);
            if is_lit && is_gltf && !geometry.submeshes.iter().all(has_normals) {
                let message = "its file has no normals: they are smooth, where glTF has flat ones";
                notes.push(format!("{name}: {message}"));
            }
            let mut object = Object::from_geometry(name, geometry, &model, places.collect())?;
            self.dress(&mut object, &mesh.material, entry)?;
            objects.push(object);
        }
        Ok(objects)
    }

    /// Makes surfaces of fields of the objects whose fields are learnt.
    pub(super) fn grow_fields(
        &self,
        description: &Description,
        objects: &mut [Object],
    ) -> Result<(), SceneError> {
        let Some(entry) = &description.learn.field else { return Ok(()) };
        let cells = entry.cells.map_or(CELLS, |cells| cells.0);
        let smoothing = entry.smoothing.map_or(SMOOTHINGS, |passes| passes.0);
        let location = Location::new(&self.path);
        for object in objects {
            if entry.meshes.as_ref().is_some_and(|meshes| !meshes.contains(&object.name)) {
                continue;
            }
            let is_open = object.mesh.adjacency().boundary_edges() > 0;
            if let Some(reason) = object.fixed().or(is_open.then_some("has a border")) {
                let rule = "a mesh whose `field` is learnt is closed, and has one material, no textures, and one colour at a vertex if any";
                let message = format!("{rule}, and {:?} {reason}", object.name);
                return Err(SceneError::content(location, message));
            }
            let what = || format!("a field of {cells} cells along a side");
            let bytes = (cells as u64 + 3).pow(3) * OF_POINT;
            self.folder.memory().check(bytes, &location, what)?;
            object.grow_field(cells, smoothing)?;
        }
        Ok(())
    }

    /// Takes the memory of textures of a mesh, before they are made.
    fn claim_texels(&self, texels: u64, entry: &Spanned<MeshEntry>) -> Result<(), SceneError> {
        let [kept, meanwhile] = [OF_TEXEL, OF_NEW_TEXEL].map(|bytes| texels.saturating_mul(bytes));
        let location = match &entry.get_ref().file {
            Some(file) => Location::new(self.folder.join(file)),
            None => self.location(entry),
        };
        let what = || format!("textures of {texels} texels");
        self.folder.memory().take(kept, meanwhile, &location, what)
    }

    /// What the scene says of an object's materials, all of them, in place of what its file says.
    fn dress(
        &self,
        object: &mut Object,
        given: &MaterialEntry,
        entry: &Spanned<MeshEntry>,
    ) -> Result<(), SceneError> {
        for material in &mut object.materials {
            self.dress_material(material, given, entry)?;
        }
        if given.vertex_colors && object.colors.is_none() {
            object.color_vertices()?;
        }
        for material in &object.materials {
            let is_placed = object
                .coordinates
                .as_ref()
                .is_some_and(|coordinates| coordinates.covers(&material.faces));
            if !is_placed && material.has_maps() {
                let rule = "a mesh with a texture has texture coordinates";
                let message = format!("{rule}, and {:?} has none", object.material_name(material));
                return Err(self.wrong(entry, message));
            }
        }
        Ok(())
    }

    fn dress_material(
        &self,
        material: &mut SurfaceMaterial,
        given: &MaterialEntry,
        entry: &Spanned<MeshEntry>,
    ) -> Result<(), SceneError> {
        if let Some(color) = given.base_color {
            material.base_color = color.map(|x| x.0 as f32);
            material.texture = SurfaceMap::default();
        }
        if let Some(roughness) = given.roughness {
            material.roughness = roughness.0 as f32;
            material.roughness_metallic = SurfaceMap::default();
        }
        if let Some(metallic) = given.metallic {
            material.metallic = metallic.0 as f32;
            material.roughness_metallic = SurfaceMap::default();
        }
        let map = |texels| SurfaceMap { texels: Some(texels), ..SurfaceMap::default() };
        match (&given.texture, given.texture_size) {
            (None, None) => {}
            (Some(file), None) => {
                let image = self.image(file)?;
                self.claim_texels(image.pixels() as u64, entry)?;
                material.texture = map(image.color(ColorSpace::for_picture(&image)));
            }
            (None, Some(size)) => {
                let samples = (3 * size.0 as u64).saturating_mul(size.0 as u64);
                self.at_most(entry, "samples of an image", MOST_SAMPLES, samples)?;
                self.claim_texels(samples / 3, entry)?;
                let color = material.base_color;
                let texels = Tensor::from_flat_fn([size.0, size.0, 3], |k| color[k % 3]);
                material.texture = map(texels);
            }
            _ => {
                let rule = "a material has either `texture` or `texture_size`";
                return Err(self.wrong(entry, rule));
            }
        }
        if let Some(file) = &given.normals {
            let image = self.image(file)?;
            self.claim_texels(image.pixels() as u64, entry)?;
            material.normal_map = map(vectors(&image, 1.0));
        }
        Ok(())
    }
}
