//! Nodes: where meshes stand.
//!
//! The nodes below the default scene are read; where no scene is the default one, those of the first, with a
//! note where there are more. What stands outside is noted. A file without scenes has all nodes, and one without
//! nodes has each mesh once, as it is. A node has one parent at most and is not its own ancestor: so nodes are
//! trees, which are walked without recursion.

use ::gltf::json::Root;
use ::gltf::json::scene::Node;
use glam::{DMat4, DQuat, DVec3};

use crate::mesh::notes::Notes;

/// The nodes of a file, which are trees.
#[derive(Debug)]
pub(super) struct Nodes<'r> {
    pub(super) root: &'r Root,
    /// The nodes without a parent.
    all: Vec<usize>,
    /// Those of them that are read.
    tops: Vec<usize>,
}

impl<'r> Nodes<'r> {
    /// The nodes of a file, or the rule that they break.
    pub(super) fn new(root: &'r Root, notes: &mut Notes) -> Result<Self, String> {
        let count = root.nodes.len();
        let mut has_parent = vec![false; count];
        for (number, node) in root.nodes.iter().enumerate() {
            for child in children(node) {
                let Some(has_parent) = has_parent.get_mut(child) else {
                    let message = format!("node {number} names child {child}");
                    return Err(format!("the file has {count} nodes, and {message}"));
                };
                if std::mem::replace(has_parent, true) {
                    let rule = "a node is the child of one node at most";
                    return Err(format!("{rule}, and node {child} is the child of more"));
                }
            }
        }
        let all: Vec<usize> = (0..count).filter(|&node| !has_parent[node]).collect();
        // With one parent each, nodes that no node without a parent leads to are in a circle.
        let mut is_reached = vec![false; count];
        walk(root, &all, |node, _| is_reached[node] = true);
        if let Some(node) = is_reached.iter().position(|is_reached| !is_reached) {
            let rule = "a node is not below itself";
            return Err(format!("{rule}, and node {node} is in a circle of children"));
        }
        let number = match root.scene {
            Some(scene) => scene.value(),
            None if root.scenes.is_empty() => return Ok(Self { root, tops: all.clone(), all }),
            None => 0,
        };
        let scenes = root.scenes.len();
        let Some(scene) = root.scenes.get(number) else {
            return Err(format!("the file has {scenes} scenes, and the default one is {number}"));
        };
        if root.scene.is_none() && scenes > 1 {
            let message = format!("the file has {scenes} scenes, and none is the default one");
            notes.add(format!("{message}: the first was read"));
        }
        let tops: Vec<usize> = scene.nodes.iter().map(|node| node.value()).collect();
        let mut is_top = vec![false; count];
        for &top in &tops {
            let Some(is_top) = is_top.get_mut(top) else {
                return Err(format!("the file has {count} nodes, and a scene names {top}"));
            };
            if has_parent[top] || std::mem::replace(is_top, true) {
                let rule = "a scene names nodes without a parent, each once";
                return Err(format!("{rule}, and node {top} has one or is there again"));
            }
        }
        let nodes = Self { root, all, tops };
        let has_mesh = |node: &Node| node.mesh.is_some();
        let mut outside = root.nodes.iter().filter(|node| has_mesh(node)).count();
        nodes.walk(|node, _| outside -= usize::from(has_mesh(&root.nodes[node])));
        notes.count("a mesh of a node outside the scene that is read was left out", outside);
        Ok(nodes)
    }

    /// Gives each node that is read and its matrix to the world to `visit`.
    pub(super) fn walk(&self, visit: impl FnMut(usize, DMat4)) {
        walk(self.root, &self.tops, visit);
    }

    /// The nodes that are read: parents first, siblings in their order.
    pub(super) fn read(&self) -> Vec<usize> {
        let mut all = Vec::new();
        self.walk(|node, _| all.push(node));
        all
    }

    /// The matrix of each node to the world, whatever scene it is in.
    pub(super) fn world(&self) -> Vec<DMat4> {
        let mut all = vec![DMat4::IDENTITY; self.root.nodes.len()];
        walk(self.root, &self.all, |node, matrix| all[node] = matrix);
        all
    }
}

/// Gives each node below `tops` and its matrix to the world to `visit`: parents first, siblings in their order.
fn walk(root: &Root, tops: &[usize], mut visit: impl FnMut(usize, DMat4)) {
    let mut stack: Vec<(usize, DMat4)> = Vec::new();
    stack.extend(tops.iter().rev().map(|&top| (top, DMat4::IDENTITY)));
    while let Some((number, parent)) = stack.pop() {
        let node = &root.nodes[number];
        let matrix = parent * local(node);
        visit(number, matrix);
        let below = stack.len();
        stack.extend(children(node).map(|child| (child, matrix)));
        stack[below..].reverse();
    }
}

fn children(node: &Node) -> impl Iterator<Item = usize> {
    node.children.iter().flatten().map(|child| child.value())
}

/// From a node's coordinates to its parent's.
fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector = |numbers: [f32; 3]| DVec3::from_array(numbers.map(f64::from));
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |rotation| {
        let rotation = DQuat::from_array(rotation.0.map(f64::from));
        // Its length is 1 to within the rounding of `f32`. One of length 0 turns nothing.
        match rotation.length_squared() {
            0.0 => DQuat::IDENTITY,
            _ => rotation.normalize(),
        }
    });
    let scale = node.scale.map_or(DVec3::ONE, vector);
    let translation = node.translation.map_or(DVec3::ZERO, vector);
    DMat4::from_scale_rotation_translation(scale, rotation, translation)
}
