//! Poses: with which weights of morph targets, and by which joints, nodes show meshes.
//!
//! The weights are those of the node, or else those of the mesh. A mesh that nodes show in several poses has a
//! geometry for each of them.

use std::collections::HashMap;

use glam::DMat4;

use super::file::GltfFile;
use super::nodes::Nodes;
use super::skins::Skin;
use crate::error::SceneError;
use crate::mesh::notes::name;
use crate::model::{Model, Placed};

/// How a mesh is shown.
#[derive(Debug)]
pub(super) struct Pose {
    /// The mesh's number.
    pub(super) mesh: usize,
    /// Of morph targets, without zeros at the end.
    pub(super) weights: Vec<f32>,
    /// Which of [`Poses::skins`] bends it.
    pub(super) skin: Option<usize>,
}

/// All poses of a file's meshes, each once, in the order of the meshes.
#[derive(Debug)]
pub(super) struct Poses {
    pub(super) all: Vec<Pose>,
    /// The pose of each node that shows a mesh.
    of_nodes: HashMap<usize, usize>,
    pub(super) skins: Vec<Skin>,
}

impl Poses {
    /// The poses in which nodes show meshes. A mesh that no node shows has its own weights.
    pub(super) fn new(nodes: &Nodes<'_>, file: &mut GltfFile<'_, '_>) -> Result<Self, SceneError> {
        let root = file.root;
        let mut poses = Self { all: Vec::new(), of_nodes: HashMap::new(), skins: Vec::new() };
        let (mut numbers, mut skins, mut world) = (HashMap::new(), HashMap::new(), None);
        let mut is_shown = vec![false; root.meshes.len()];
        for number in nodes.read() {
            let node = &root.nodes[number];
            let Some(mesh) = node.mesh.map(|mesh| mesh.value()) else { continue };
            let Some(shown) = root.meshes.get(mesh) else {
                let count = root.meshes.len();
                let message = format!("the file has {count} meshes, and node {number} has {mesh}");
                return Err(file.error(message));
            };
            is_shown[mesh] = true;
            let skin = match node.skin.map(|skin| skin.value()) {
                None => None,
                Some(skin) => Some(match skins.get(&skin) {
                    Some(&number) => number,
                    None => {
                        let world = world.get_or_insert_with(|| nodes.world());
                        poses.skins.push(Skin::new(skin, world, file)?);
                        skins.insert(skin, poses.skins.len() - 1);
                        poses.skins.len() - 1
                    }
                }),
            };
            let weights = node.weights.as_ref().or(shown.weights.as_ref());
            let pose = poses.add(&mut numbers, mesh, weights, skin);
            poses.of_nodes.insert(number, pose);
        }
        for (mesh, shown) in root.meshes.iter().enumerate().filter(|(mesh, _)| !is_shown[*mesh]) {
            poses.add(&mut numbers, mesh, shown.weights.as_ref(), None);
        }
        poses.sort();
        Ok(poses)
    }

    /// Brings the poses into the order of their meshes.
    fn sort(&mut self) {
        let mut all: Vec<_> = std::mem::take(&mut self.all).into_iter().enumerate().collect();
        all.sort_by_key(|(_, pose)| pose.mesh);
        let mut numbers = vec![0; all.len()];
        for (number, (before, pose)) in all.into_iter().enumerate() {
            numbers[before] = number;
            self.all.push(pose);
        }
        self.of_nodes.values_mut().for_each(|pose| *pose = numbers[*pose]);
    }

    /// The number of a pose, which is added where it is new.
    fn add(
        &mut self,
        numbers: &mut HashMap<(usize, Vec<u32>, Option<usize>), usize>,
        mesh: usize,
        weights: Option<&Vec<f32>>,
        skin: Option<usize>,
    ) -> usize {
        let weights = weights.map_or(&[][..], Vec::as_slice);
        let end = weights.iter().rposition(|&weight| weight != 0.0).map_or(0, |last| last + 1);
        let weights = &weights[..end];
        let key = (mesh, weights.iter().map(|weight| weight.to_bits()).collect(), skin);
        *numbers.entry(key).or_insert_with(|| {
            self.all.push(Pose { mesh, weights: weights.to_vec(), skin });
            self.all.len() - 1
        })
    }

    /// Places the geometry of each pose where the nodes have it.
    pub(super) fn add_to_model(
        &self,
        nodes: &Nodes<'_>,
        geometries: &[Option<usize>],
        model: &mut Model,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<(), SceneError> {
        if nodes.root.nodes.is_empty() {
            for (geometry, drawn) in model.geometries.iter().enumerate() {
                let (name, transform) = (drawn.name.clone(), DMat4::IDENTITY);
                model.placed.push(Placed { name, geometry, transform });
            }
            return Ok(());
        }
        let mut posed = Vec::new();
        nodes.walk(|number, matrix| {
            if let Some(pose) = self.of_nodes.get(&number).copied() {
                // What a skin bends stands in the world.
                let is_bent = self.all[pose].skin.is_some();
                posed.push((number, pose, if is_bent { DMat4::IDENTITY } else { matrix }));
            }
        });
        for (number, pose, transform) in posed {
            if !transform.is_finite() {
                let rule = "a node's matrix is finite";
                return Err(file.error(format!("{rule}, and that of node {number} is not")));
            }
            let name = name(nodes.root.nodes[number].name.as_deref().unwrap_or_default());
            let bytes = size_of::<Placed>() + name.len();
            if let Some(geometry) = geometries[pose] {
                file.spend(1, bytes)?;
                model.placed.push(Placed { name, geometry, transform });
            }
        }
        if model.placed.is_empty() && !model.geometries.is_empty() {
            file.note("no node places a mesh");
        }
        Ok(())
    }
}
