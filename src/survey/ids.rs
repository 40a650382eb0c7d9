//! Ids that are the same in every file and in every program's tables: made from names and from what surveys are known by.

use crate::export::sha256_of_bytes;

/// Digits of a sum that make an id: 64 bits.
const N_DIGITS: usize = 16;

fn id(kind: &str, of: &str) -> String {
    let sum = sha256_of_bytes(of.as_bytes());
    format!("{kind}-{}", &sum[..N_DIGITS])
}

/// The id of a hall.
#[must_use]
pub fn of_hall(name: &str) -> String {
    id("hall", name)
}

/// The id of a bay. Names cannot hold a line's end, so no two pairs are one text.
#[must_use]
pub fn of_bay(hall_id: &str, name: &str) -> String {
    id("bay", &format!("{hall_id}\n{name}"))
}

/// The id of a material.
#[must_use]
pub fn of_material(name: &str) -> String {
    id("material", name)
}

/// The id of a survey, from what it is known by ([`crate::record::LoggedSurvey::identity`]): a log that has grown
/// does not change it.
#[must_use]
pub fn of_survey(identity: &str) -> String {
    format!("survey-{}", identity.get(..N_DIGITS).unwrap_or(identity))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// They stand in other programs' tables: a change here would tear them apart.
    #[test]
    fn ids_stay_what_they_are() {
        // printf 'Nord' | sha256sum; printf 'hall-…\nsalt' | sha256sum
        assert_eq!(of_hall("Nord").len(), 21);
        assert_eq!(of_hall("Nord"), of_hall("Nord"));
        assert_ne!(of_bay(&of_hall("Nord"), "salt"), of_bay(&of_hall("Süd"), "salt"));
        assert_eq!(of_survey("0123456789abcdef0123"), "survey-0123456789abcdef");
    }
}
