//! The prelude of `bokashi`: what it has, and what it hides.

use std::collections::BTreeSet;

/// Modules that a user's program may have.
mod theirs {
    pub(super) mod glam {
        pub(in crate::prelude) const IS_THEIRS: bool = true;
    }
    pub(super) mod camera {
        pub(in crate::prelude) const IS_THEIRS: bool = true;
    }
}

/// Names of two globs that are one would not compile.
mod program {
    use super::theirs::*;
    #[allow(unused_imports, reason = "the question is what its names hide")]
    use bokashi::prelude::*;

    pub(super) fn uses_theirs() -> bool {
        glam::IS_THEIRS && camera::IS_THEIRS
    }
}

#[test]
fn the_prelude_hides_no_module_of_a_users() {
    assert!(program::uses_theirs());
}

#[test]
fn the_prelude_has_all_of_the_rendering_operations() {
    // What `pub use a::{B, c};` and `pub use a::b;` hand on.
    let source = include_str!("../../crates/render-ops/src/lib.rs");
    let shown = source.replace("#[doc(hidden)]\npub use ", "");
    let uses = shown.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next());
    let names = uses.flat_map(|path| {
        let list = path.rsplit_once("::").map_or("", |(_, names)| names);
        list.trim_matches(['{', '}']).split(',').map(str::trim)
    });
    let facade = include_str!("../../crates/bokashi/src/lib.rs");
    let (_, prelude) = facade.split_once("pub use bokashi_render_ops::{").unwrap();
    let prelude: BTreeSet<&str> =
        prelude.split(';').next().unwrap().split([',', '}']).map(str::trim).collect();
    for name in names.filter(|name| !name.is_empty()) {
        assert!(prelude.contains(name), "the prelude lacks {name}");
    }
}
