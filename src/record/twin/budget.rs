//! The recorded form of a volume's budget, readable again: the change between two surveys needs it.

use crate::messages::{BudgetRow, BudgetSource, SharedSensitivity, VolumeBudget};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "BudgetSource", rename_all = "snake_case")]
enum BudgetSourceTwin {
    Prior,
    BeamNoise,
    Roughness,
    Occlusion,
    HiddenGround,
    Pose,
    LidarMounting,
    RangeBias,
    RangeScale,
    ClockOffset,
    MarkerMap,
    Base,
    Density,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "BudgetRow")]
struct RowTwin {
    #[serde(with = "BudgetSourceTwin")]
    source: BudgetSource,
    var_m6: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "SharedSensitivity")]
struct SharedTwin {
    #[serde(with = "BudgetSourceTwin")]
    source: BudgetSource,
    component: usize,
    dv_dc: f64,
    sigma: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct RowItem(#[serde(with = "RowTwin")] BudgetRow);

#[derive(Serialize, Deserialize, JsonSchema)]
struct SharedItem(#[serde(with = "SharedTwin")] SharedSensitivity);

#[derive(Serialize, Deserialize, JsonSchema)]
struct Lists {
    rows: Vec<RowItem>,
    shared: Vec<SharedItem>,
}

/// A budget as its two lists.
pub(in crate::record) struct BudgetTwin;

impl BudgetTwin {
    pub(in crate::record) fn serialize<S: Serializer>(
        budget: &VolumeBudget,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        Lists {
            rows: budget.rows.iter().copied().map(RowItem).collect(),
            shared: budget.shared.iter().copied().map(SharedItem).collect(),
        }
        .serialize(to)
    }

    pub(in crate::record) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<VolumeBudget, D::Error> {
        let lists = Lists::deserialize(from)?;
        Ok(VolumeBudget {
            rows: lists.rows.into_iter().map(|item| item.0).collect(),
            shared: lists.shared.into_iter().map(|item| item.0).collect(),
        })
    }
}

impl JsonSchema for BudgetTwin {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "VolumeBudget".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Lists::json_schema(generator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_comes_back_to_the_last_bit_with_the_public_names() {
        let mut budget = VolumeBudget::default();
        for (source, k) in BudgetSource::ALL.into_iter().zip(1_u32..) {
            budget.push_shared(source, &[(0.1 * f64::from(k), 1.0 / 3.0), (-7.3e-5, 0.7)]);
        }
        let json = BudgetTwin::serialize(&budget, serde_json::value::Serializer).expect("json");
        for source in BudgetSource::ALL {
            assert!(json.to_string().contains(&format!("\"{}\"", source.name())), "{source:?}");
        }
        let text = json.to_string();
        let mut reader = serde_json::Deserializer::from_str(&text);
        assert_eq!(BudgetTwin::deserialize(&mut reader).expect("budget"), budget);
    }
}
