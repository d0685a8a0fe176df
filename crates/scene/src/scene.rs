//! A scene in memory: objects, views and their cameras, as `scene.toml` names them.
//!
//! Images stay where they are until their turn comes: see `targets`.

use std::collections::HashSet;
use std::ops::RangeInclusive;
use std::path::{Component, Path, PathBuf};

use bokashi_core::Tensor;
use bokashi_fit::Given;
use bokashi_render_ops::Size;
use glam::{DMat4, DVec3};
use toml::Spanned;

use crate::cameras::{Camera, read_colmap, read_transforms};
use crate::description::{
    ColorSpaceName, Description, MaterialEntry, MeshEntry, Opening, Shape, SilhouettesName,
    SurfaceModel, ViewEntry, ViewLens,
};
use crate::environment::cube_from_panorama;
use crate::error::{Location, SceneError};
use crate::file_names::{is_file_name, notes_of_names};
use crate::folder::Folder;
use crate::hull::{AGREEMENT, hull_of_views};
use crate::mask_files::{find_mask, usual_mask};
use crate::memory::{OF_DRAWN_PIXEL, OF_FACE, OF_NEW_TEXEL, OF_POINT, OF_TEXEL};
use crate::mesh::{MeshKind, MeshOptions, read_counted};
use crate::model::{Geometry, Model, Placed, Submesh, covers};
use crate::object::{Object, SurfaceMap, SurfaceMaterial, vectors};
use crate::picture::{ColorSpace, MOST_SAMPLES, Picture};
use crate::scene_view::SceneView;
use crate::shapes;
use crate::viewpoint::camera;

/// A scene: what its file says, with the meshes and cameras that the file names.
///
/// All of it can be changed before a fit.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Its file, for messages.
    pub path: PathBuf,
    /// Where its files are.
    pub folder: Folder,
    /// What its file says.
    pub description: Description,
    /// The meshes.
    pub objects: Vec<Object>,
    /// The views.
    pub views: Vec<SceneView>,
    /// The texels of its environment, a cube map `[6, S, S, 3]`.
    pub environment: Option<Tensor<f32>>,
    /// What files hold that was left out or mended, in words.
    pub notes: Vec<String>,
    /// The files that were read to load it but its own, with their lengths and checksums in words.
    pub(crate) files: Given,
}

/// Faces of a shape, where a scene does not say.
const FACES: usize = 1280;
/// Likewise of a hull.
const FACES_OF_HULL: usize = 4000;
/// The most faces of a shape.
const MOST_FACES: u64 = 10_000_000;
/// Texels along a side of an environment; and where a scene does not say.
const SIDES: RangeInclusive<usize> = 8..=256;
const SIDE: usize = 16;
/// Likewise of a panorama.
const PANORAMA: RangeInclusive<usize> = 8..=64;

/// Cells along the longest side of a field's grid, where a scene does not say; and how many times it is smoothed.
const CELLS: usize = 48;
const SMOOTHINGS: usize = 2;

/// What a scene's file says, and where it says it.
struct Source {
    folder: Folder,
    path: PathBuf,
    text: String,
}

impl Source {
    fn location<T>(&self, entry: &Spanned<T>) -> Location {
        Location::from_byte(&self.text, &self.path, entry.span().start)
    }

    fn wrong<T>(&self, entry: &Spanned<T>, message: impl std::fmt::Display) -> SceneError {
        SceneError::content(self.location(entry), message)
    }

    /// Refuses an entry that takes more memory than a scene may.
    fn at_most<T>(
        &self,
        entry: &Spanned<T>,
        what: &'static str,
        most: u64,
        found: u64,
    ) -> Result<(), SceneError> {
        match found > most {
            true => Err(SceneError::TooLarge { location: self.location(entry), what, most, found }),
            false => Ok(()),
        }
    }
}

impl Scene {
    /// The views that have an image, by their indices: those that are held out, or the others.
    pub fn views_with_image(&self, are_held_out: bool) -> impl Iterator<Item = usize> {
        let views = self.views.iter().enumerate();
        let views = views.filter(move |(_, view)| view.held_out == are_held_out);
        views.filter(|(_, view)| view.image.is_some()).map(|(index, _)| index)
    }

    /// The scene of the file at `path`; all its files lie in that file's folder.
    ///
    /// # Errors
    /// Whatever is wrong with the file, or with a mesh or a file of cameras that it names.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let folder = Folder::new(path.parent().unwrap_or(Path::new(".")))?;
        let name = path.file_name().map(PathBuf::from).unwrap_or_default();
        let source = Source { text: folder.read_text(&name)?, path: path.to_owned(), folder };
        let description = Description::parse(&source.text, path)?;
        let is_lit = match description.pipeline.surface {
            Some(model) => model != SurfaceModel::Unlit,
            None => !description.lights.is_empty() || description.environment.is_some(),
        };
        source.check_lens(&description)?;
        let mut notes = Vec::new();
        let views = source.views(&description, &mut notes)?;
        let mut objects = Vec::new();
        for entry in &description.meshes {
            objects.extend(source.objects(entry, &views, is_lit, &mut notes)?);
        }
        source.grow_fields(&description, &mut objects)?;
        for SceneView { camera: Camera { size, .. }, .. } in &views {
            let (what, found) = ("pixels of a view", size.width as u64 * size.height as u64);
            if found > MOST_SAMPLES {
                let location = Location::new(path);
                return Err(SceneError::TooLarge { location, what, most: MOST_SAMPLES, found });
            }
        }
        check_views(&source.folder, &views, &description, OF_DRAWN_PIXEL)?;
        notes.extend(one_lens(&description, &views));
        check_names("a mesh", objects.iter().map(|object| &object.name), path)?;
        check_names("a view", views.iter().map(|view| &view.name), path)?;
        notes.extend(notes_of_names("the meshes", objects.iter().map(|object| &object.name)));
        notes.extend(notes_of_names("the views", views.iter().map(|view| &view.name)));
        let environment = source.environment(&description)?;
        let Source { path, folder, .. } = source;
        let files = folder.files_read().into_iter().filter(|(file, _)| *file != name);
        let files = files.map(|(file, digest)| (file.display().to_string(), digest)).collect();
        let mut scene =
            Self { path, folder, description, objects, views, environment, notes, files };
        for object in &scene.objects {
            let has_map =
                object.materials.iter().any(|material| material.normal_map.texels.is_some());
            if has_map && object.tangents.is_some() && scene.learns_vertices(object) {
                let message = "its vertices are learnt, so tangents follow from its coordinates";
                let note = format!("{}: {message}, not from its file", object.name);
                scene.notes.push(note);
            }
        }
        Ok(scene)
    }

    /// The middle of the objects, and the radius of a ball around them; of nothing, the origin and 1.
    pub fn ball(&self) -> (DVec3, f64) {
        let extents = self.objects.iter().filter_map(Object::extent);
        match extents.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]) {
            Some([least, largest]) => {
                let radius = 0.5 * least.distance(largest);
                (0.5 * (least + largest), if radius > 0.0 { radius } else { 1.0 })
            }
            None => (DVec3::ZERO, 1.0),
        }
    }

    /// Whether the places of an object's vertices are learnt.
    pub(crate) fn learns_vertices(&self, object: &Object) -> bool {
        let names = |names: &Vec<String>| names.contains(&object.name);
        let learnt = self.description.learn.vertices.as_ref();
        learnt.is_some_and(|learnt| learnt.meshes.as_ref().is_none_or(names))
    }

    /// The view `name`.
    pub fn view(&self, name: &str) -> Option<usize> {
        self.views.iter().position(|view| view.name == name)
    }
}

/// Checks that there is memory for the largest of these views, of whose pixels each takes so many bytes. Behind a lens
/// each hidden surface takes as many, and all blurs together: measured, four times as many for two surfaces. All that is
/// of each sample.
///
/// # Errors
/// [`SceneError::Memory`] at the view's image, or the folder where it has none.
pub(crate) fn check_views(
    folder: &Folder,
    views: &[SceneView],
    description: &Description,
    of_pixel: u64,
) -> Result<(), SceneError> {
    let lens = description.pipeline.lens;
    let of_pixel = of_pixel
        * lens.map_or(1, |lens| {
            (2 + lens.surface_count() as u64) * lens.sample_count().pow(2) as u64
        });
    let pixels = |view: &SceneView| view.camera.size.width as u64 * view.camera.size.height as u64;
    let Some(largest) = views.iter().max_by_key(|view| pixels(view)) else { return Ok(()) };
    let path = largest.image.as_ref().map_or(folder.path().to_owned(), |file| folder.join(file));
    let Size { width, height } = largest.camera.size;
    let what = || format!("the view {:?} of {width} x {height}", largest.name);
    folder.memory().check(pixels(largest).saturating_mul(of_pixel), &Location::new(path), what)
}

/// A note where one lens is learnt for views that have several.
fn one_lens(description: &Description, views: &[SceneView]) -> Option<String> {
    description.learn.distortion.as_ref()?;
    let (first, rest) = views.split_first()?;
    let others = rest.iter().filter(|view| view.camera.distortion != first.camera.distortion);
    let others = others.count();
    (others > 0).then(|| {
        let rule = "`learn.distortion` learns one lens for all views";
        let name = &first.name;
        format!("{rule}: it starts from that of {name:?}, and {others} others are left out")
    })
}

/// Names are those of parameters and files: there is each of them once.
fn check_names<'a>(
    what: &str,
    names: impl Iterator<Item = &'a String>,
    path: &Path,
) -> Result<(), SceneError> {
    let mut seen = HashSet::new();
    for name in names {
        let wrong = |rule: &str| {
            let message = format!("the name of {what} {rule}, and there is {name:?}");
            Err(SceneError::content(Location::new(path), message))
        };
        if !is_file_name(name) {
            return wrong("is that of a file");
        }
        if !seen.insert(name) {
            return wrong("is its own");
        }
    }
    Ok(())
}

/// A path's last part without its ending.
fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

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
    fn objects(
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
    fn grow_fields(
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

    fn image(&self, file: &Path) -> Result<Picture, SceneError> {
        Picture::read(&self.folder, file)
    }

    /// All views: those of the scene's file, then those of files of cameras.
    fn views(
        &self,
        description: &Description,
        notes: &mut Vec<String>,
    ) -> Result<Vec<SceneView>, SceneError> {
        let entries = || description.views.iter().map(Spanned::get_ref);
        let given = entries().filter_map(|entry| entry.name.clone()).collect();
        let is_unnamed = |entry: &&ViewEntry| entry.name.is_none();
        let unnamed = entries().filter(is_unnamed).filter_map(|view| view.image.as_deref());
        let mut unnamed = names(unnamed, &given).into_iter();
        let mut views = Vec::with_capacity(description.views.len());
        for entry in &description.views {
            let view = entry.get_ref();
            let of_image = || view.image.as_ref().and_then(|_| unnamed.next());
            let Some(name) = view.name.clone().or_else(of_image) else {
                return Err(self.wrong(entry, "a view without an image has a `name`"));
            };
            views.push(self.view(entry, name)?);
        }
        let Some(entry) = &description.cameras else { return Ok(views) };
        let cameras = entry.get_ref();
        let file = match (&cameras.transforms, &cameras.colmap) {
            (Some(file), None) => read_transforms(&self.folder, file)?,
            (None, Some(model)) => {
                let images = cameras.images.as_deref().unwrap_or(Path::new("images"));
                read_colmap(&self.folder, model, images)?
            }
            _ => {
                let rule = "cameras are in either `transforms` or `colmap`";
                return Err(self.wrong(entry, rule));
            }
        };
        notes.extend(file.notes);
        let every = cameras.held_out_every.map(|every| every.0);
        let taken: HashSet<_> = views.iter().map(|view| view.name.clone()).collect();
        let unnamed = names(file.views.iter().map(|view| view.image.as_path()), &taken);
        for (index, (view, name)) in file.views.into_iter().zip(unnamed).enumerate() {
            let mask = match &cameras.masks {
                None => view.mask,
                // One that is missing is missed when its turn comes.
                Some(masks) => find_mask(&self.folder, masks, &view.image)
                    .or(view.mask)
                    .or_else(|| Some(usual_mask(masks, &view.image))),
            };
            views.push(SceneView {
                name,
                image: Some(view.image),
                mask,
                color_space: cameras.color_space.map(color_space),
                held_out: every.is_some_and(|every| index.is_multiple_of(every)),
                exposure: 0.0,
                camera: view.camera,
                lens: ViewLens::default(),
            });
        }
        Ok(views)
    }

    fn view(&self, entry: &Spanned<ViewEntry>, name: String) -> Result<SceneView, SceneError> {
        let view = entry.get_ref();
        let size = match (view.camera.size, &view.image) {
            (Some(size), _) => size.map(|extent| extent.0),
            (None, Some(file)) => Picture::read_size(&self.folder, file)?,
            (None, None) => {
                let rule = "the camera of a view without an image has a `size`";
                return Err(self.wrong(entry, rule));
            }
        };
        Ok(SceneView {
            camera: camera(&view.camera, size).map_err(|rule| self.wrong(entry, rule))?,
            name,
            image: view.image.clone(),
            mask: view.mask.clone(),
            color_space: view.color_space.map(color_space),
            held_out: view.held_out,
            exposure: view.exposure.map_or(0.0, |stops| stops.0),
            lens: view.lens,
        })
    }

    /// # Errors
    /// [`SceneError::Content`] for a lens that can't be drawn as the scene says.
    fn check_lens(&self, description: &Description) -> Result<(), SceneError> {
        let lens = description.pipeline.lens;
        if lens.is_some() && description.pipeline.silhouettes == SilhouettesName::Antialias {
            let rule = "the `silhouettes` of a picture through a lens are \"exact\" or \"aliased\"";
            let message = format!("{rule}, and these are \"antialias\"");
            return Err(SceneError::content(Location::new(&self.path), message));
        }
        for entry in &description.views {
            let given = entry.get_ref().lens;
            match (lens, given.opening) {
                (None, _) if given != ViewLens::default() => {
                    let rule = "a view has a `lens` of its own where `pipeline.lens` is there";
                    return Err(self.wrong(entry, rule));
                }
                (Some(lens), Some(own)) if own.key() != lens.opening.key() => {
                    let rule = "the lens of a view has the key that `pipeline.lens` has";
                    let [expected, found] = [lens.opening, own].map(Opening::key);
                    let message = format!("{rule}, `{expected}`, and this has `{found}`");
                    return Err(self.wrong(entry, message));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn environment(&self, description: &Description) -> Result<Option<Tensor<f32>>, SceneError> {
        let Some(entry) = &description.environment else { return Ok(None) };
        let light = entry.get_ref();
        let check = |side: usize| match SIDES.contains(&side) && side.is_power_of_two() {
            true => Ok(side),
            false => {
                let rule = "the side of a cube map is a power of two from 8 to 256";
                Err(self.wrong(entry, format!("{rule}, and this is {side}")))
            }
        };
        match (&light.image, light.color) {
            (Some(file), None) => {
                let image = self.image(file)?;
                let [width, height] = [image.width, image.height];
                let texels = image.color(ColorSpace::for_picture(&image));
                match light.size {
                    None if height == 6 * width => {
                        let shape = [6, check(width)?, width, 3];
                        Ok(Some(Tensor::from_flat_fn(shape, |k| texels.data()[k])))
                    }
                    size if width == 2 * height => {
                        // At the horizon a texel is as wide as a pixel.
                        let usual = *PANORAMA.end().min(&(width / 4).max(*PANORAMA.start()));
                        let side = size.map_or(1 << usual.ilog2(), |size| size.0);
                        Ok(Some(cube_from_panorama(&texels, check(side)?)))
                    }
                    _ => {
                        let rule = "an environment's image is a panorama, twice as wide as high, or \
                             without `size` six faces, one below the other";
                        let message =
                            format!("{rule}, and {} is {width} x {height}", file.display());
                        Err(self.wrong(entry, message))
                    }
                }
            }
            (None, Some(color)) => {
                let side = check(light.size.map_or(SIDE, |size| size.0))?;
                Ok(Some(Tensor::from_flat_fn([6, side, side, 3], |k| color[k % 3].0 as f32)))
            }
            _ => {
                let rule = "an environment has either `image` or `color`, and perhaps `size`";
                Err(self.wrong(entry, rule))
            }
        }
    }
}

fn color_space(name: ColorSpaceName) -> ColorSpace {
    match name {
        ColorSpaceName::Srgb => ColorSpace::Srgb,
        ColorSpaceName::Linear => ColorSpace::Linear,
    }
}

/// A name for each image: its file's without the ending, with the folders above it where that is another's
/// name, and then with the ending.
fn names<'a>(images: impl Iterator<Item = &'a Path>, taken: &HashSet<String>) -> Vec<String> {
    let images: Vec<_> = images.collect();
    let whole = |image: &Path| {
        let parts = image.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        parts.collect::<Vec<_>>().join("-")
    };
    let ways: [&dyn Fn(&Path) -> String; 3] =
        [&stem, &|image| whole(&image.with_extension("")), &|image| match image.extension() {
            Some(ending) => {
                format!("{}-{}", whole(&image.with_extension("")), ending.to_string_lossy())
            }
            None => whole(image),
        }];
    let mut names = Vec::new();
    for way in ways {
        names = images.iter().map(|image| way(image)).collect();
        let mut seen = taken.clone();
        if names.iter().all(|name| seen.insert(name.clone())) {
            break;
        }
    }
    names
}
