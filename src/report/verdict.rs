//! Whether a survey is good enough: one rule, printed in every report.

use crate::messages::VolumeAccount;
use serde::Serialize;

/// How sure a volume must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// U (k = 2) may be this share of the volume, % …
    pub percent: f64,
    /// … or this, whichever is more, m³.
    pub least_m3: f64,
}

impl Default for Target {
    fn default() -> Self {
        Self { percent: 2.0, least_m3: 0.5 }
    }
}

/// What becomes of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It may be used as it is.
    Accepted,
    /// It may be used by those who have read the remarks.
    AcceptedWithRemark,
    /// It should be measured again.
    Repeat,
}

impl Verdict {
    /// As people read it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::AcceptedWithRemark => "accepted with remark",
            Self::Repeat => "repeat",
        }
    }
}

/// Share of the volume that nobody measured, beyond which there is a remark.
const UNMEASURED_REMARK: f64 = 0.05;
/// Share of the volume that nobody measured, beyond which the survey is to be repeated.
const UNMEASURED_REPEAT: f64 = 0.2;
/// U beyond this many times the target: repeat.
const REPEAT_TARGETS: f64 = 2.0;

impl Target {
    /// U (k = 2) that a volume may have, m³.
    #[must_use]
    pub fn allowed_m3(&self, volume_m3: f64) -> f64 {
        (0.01 * self.percent * volume_m3.abs()).max(self.least_m3)
    }

    /// Judges a volume; `remarks` are what is known against the survey as a whole.
    #[must_use]
    pub fn judge(
        &self,
        account: &VolumeAccount,
        is_final: bool,
        has_remarks: bool,
    ) -> (Verdict, Vec<String>) {
        let (expanded_m3, allowed_m3) =
            (2.0 * account.estimate.sigma_m3, self.allowed_m3(account.estimate.volume_m3));
        let unmeasured = account.shares.unseen_ratio + account.shares.disturbed_ratio;
        let mut own = Vec::new();
        if expanded_m3 > allowed_m3 {
            // The numbers stand in the tables; equal words let a report name all bays in one line.
            let Self { percent, least_m3 } = self;
            own.push(if allowed_m3 > *least_m3 {
                format!("U is more than the target of {percent} % of the volume")
            } else {
                format!("U is more than the target of {least_m3} m³")
            });
        }
        if unmeasured > UNMEASURED_REMARK {
            own.push(format!(
                "{:.0} % of the volume was not seen or is disturbed",
                100.0 * unmeasured
            ));
        }
        if !is_final {
            own.push("the volume is one of a flight under way".to_owned());
        }
        let is_bad = !is_final
            || expanded_m3.is_nan()
            || expanded_m3 > REPEAT_TARGETS * allowed_m3
            || unmeasured > UNMEASURED_REPEAT;
        let verdict = match (is_bad, own.is_empty() && !has_remarks) {
            (true, _) => Verdict::Repeat,
            (false, false) => Verdict::AcceptedWithRemark,
            (false, true) => Verdict::Accepted,
        };
        (verdict, own)
    }

    /// The rule in words.
    #[must_use]
    pub fn rule(&self) -> String {
        let Self { percent, least_m3 } = self;
        format!(
            "Accepted: U (k = 2) is at most {percent}\u{a0}% of the volume, or {least_m3}\u{a0}m³ where \
             that is more; at most {:.0}\u{a0}% of the volume was not seen or is disturbed; and nothing \
             stands in the remarks. Repeat: U is more than {REPEAT_TARGETS} times that, or more than \
             {:.0}\u{a0}% was not seen or is disturbed, or the volume is one of a flight under way, or a person \
             has rejected the survey. \
             Else: accepted with remark.",
            100.0 * UNMEASURED_REMARK,
            100.0 * UNMEASURED_REPEAT,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{VolumeBudget, VolumeEstimate, VolumeShares};
    use crate::time::Stamp;

    fn account(volume_m3: f64, sigma_m3: f64, unseen_ratio: f64) -> VolumeAccount {
        VolumeAccount {
            name: "bay".to_owned(),
            estimate: VolumeEstimate { at: Stamp::ZERO, volume_m3, sigma_m3, coverage_ratio: 1.0 },
            mass: None,
            budget: VolumeBudget::default(),
            shares: VolumeShares { unseen_ratio, ..VolumeShares::default() },
        }
    }

    #[test]
    fn the_rule_holds_at_its_borders() {
        let target = Target::default();
        let verdict = |v, s, unseen, is_final, has_remarks| {
            target.judge(&account(v, s, unseen), is_final, has_remarks).0
        };
        // 2 % of 100 m³ is U = 2 m³, σ = 1 m³.
        assert_eq!(verdict(100.0, 1.0, 0.05, true, false), Verdict::Accepted);
        assert_eq!(verdict(100.0, 1.0, 0.0, true, true), Verdict::AcceptedWithRemark);
        assert_eq!(verdict(100.0, 1.01, 0.0, true, false), Verdict::AcceptedWithRemark);
        assert_eq!(verdict(100.0, 1.0, 0.06, true, false), Verdict::AcceptedWithRemark);
        assert_eq!(verdict(100.0, 2.01, 0.0, true, false), Verdict::Repeat);
        assert_eq!(verdict(100.0, 1.0, 0.21, true, false), Verdict::Repeat);
        assert_eq!(verdict(100.0, 1.0, 0.0, false, false), Verdict::Repeat);
        assert_eq!(verdict(100.0, f64::NAN, 0.0, true, false), Verdict::Repeat);
        // An almost empty bay is judged by cubic metres.
        assert_eq!(verdict(1.0, 0.25, 0.0, true, false), Verdict::Accepted);
        assert_eq!(verdict(-1.0, 0.6, 0.0, true, false), Verdict::Repeat);
    }

    #[test]
    fn every_remark_says_what_it_is_held_against() {
        let (_, remarks) = Target::default().judge(&account(100.0, 1.5, 0.5), false, false);
        assert_eq!(remarks.len(), 3);
        assert!(remarks[1].contains("50 %"));
        assert_eq!(remarks[0], "U is more than the target of 2 % of the volume");
        let (_, remarks) = Target::default().judge(&account(1.0, 0.3, 0.0), true, false);
        assert_eq!(remarks, ["U is more than the target of 0.5 m³"]);
    }
}
