//! Which contacts are collisions (the paper's r_collision).

/// What a geom belongs to, for the classification of contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Keyboard,
    Fingertip,
    OtherLink,
}

impl Part {
    /// Which part the geom called `name` is.
    pub(crate) fn of(name: &str) -> Part {
        if name.starts_with("key_") || name.starts_with("fence_") {
            Part::Keyboard
        } else if name.ends_with("_tip") {
            Part::Fingertip
        } else {
            Part::OtherLink
        }
    }

    /// Whether a contact of the two parts is a collision: anything but a fingertip on the keyboard.
    pub(crate) fn collide(self, other: Part) -> bool {
        !matches!((self, other), (Part::Fingertip, Part::Keyboard) | (Part::Keyboard, Part::Fingertip))
    }
}

#[cfg(test)]
mod tests {
    use super::Part;

    #[test]
    fn only_fingertips_may_touch_the_keyboard() {
        let [key, fence, tip, link] = ["key_3", "fence_0", "index_tip", "ring_medial"].map(Part::of);
        assert!(!tip.collide(key) && !key.collide(tip) && !tip.collide(fence));
        assert!(link.collide(key) && tip.collide(tip) && tip.collide(link) && fence.collide(link));
    }
}
