//! Meshes that get a texture in the middle of a fit: which they are.

use crate::object::Object;
use crate::scene::Scene;

impl Scene {
    /// Whether an object gets a texture at the start of some stage: its colours are learnt at vertices until then.
    pub(crate) fn gives_texture(&self, object: &Object) -> bool {
        let learn = &self.description.learn;
        let is_named = |meshes: &Option<Vec<String>>| {
            meshes.as_ref().is_none_or(|meshes| meshes.contains(&object.name))
        };
        self.description.stages.iter().any(|stage| stage.texture.is_some())
            && learn.colors.as_ref().is_some_and(|entry| is_named(&entry.meshes))
            && learn.texture.as_ref().is_some_and(|entry| is_named(&entry.meshes))
    }

    /// Whether an object is still to get its texture.
    pub(crate) fn awaits_texture(&self, object: &Object) -> bool {
        object.colors.is_some() && self.gives_texture(object)
    }
}
