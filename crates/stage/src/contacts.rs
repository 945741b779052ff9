//! Which contacts are collisions (the paper's r_collision).

/// What a geom belongs to, for the classification of contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ContactPart {
    Keyboard,
    Fingertip,
    OtherLink,
}

impl ContactPart {
    /// Which part the geom called `name` is.
    pub(crate) fn of(name: &str) -> ContactPart {
        if name.starts_with("key_") || name.starts_with("fence_") {
            ContactPart::Keyboard
        } else if name.ends_with("_tip") {
            ContactPart::Fingertip
        } else {
            ContactPart::OtherLink
        }
    }

    /// Whether a contact of the two parts is a collision: anything but a fingertip on the keyboard.
    pub(crate) fn collide(self, other: ContactPart) -> bool {
        !matches!(
            (self, other),
            (ContactPart::Fingertip, ContactPart::Keyboard) | (ContactPart::Keyboard, ContactPart::Fingertip)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::ContactPart;

    #[test]
    fn only_fingertips_may_touch_the_keyboard() {
        let [key, fence, tip, link] = ["key_3", "fence_0", "index_tip", "ring_medial"].map(ContactPart::of);
        assert!(!tip.collide(key) && !key.collide(tip) && !tip.collide(fence));
        assert!(link.collide(key) && tip.collide(tip) && tip.collide(link) && fence.collide(link));
    }
}
