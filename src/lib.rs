//! stockpilot measures piles of bulk material from a drone that flies without GPS, and says how
//! sure it is.
//!
//! Modules stand in ranks; a module imports lower ranks only.
//!
//! | rank | module | lives there |
//! | --- | --- | --- |
//! | 0 | [`units`], [`time`] | conversions, instants |
//! | 1 | [`geometry`], [`stats`] | frames as types, transforms; gates, seeded noise |
//! | 2 | [`messages`] | plain data that modules exchange |
//! | 3 | [`localization`], [`mapping`] | where the vehicle is; what the surface is |
//! | 4 | [`planning`], [`calibration`] | where to look next, and how to get there; where the LiDAR sits |
//! | 5 | [`mission`] | phases and guards |
//! | 6 | [`pilot`] | the brain: one event in, actions out, no I/O |
//! | 7 | `link`, `lidar`, `camera`, `record` | feature `service`: the edges |
//! | 7 | `figure` | feature `figures`, part of `service`: pictures of maps and curves |
//! | 7 | `pdf`, `export` | pages in millimetres; maps and point clouds as files |
//! | 8 | `web` | the live page, its API and metrics |
//! | 9 | `config` | the file, checked and turned into the settings of all of them |
//! | 10 | `service`, `survey` | tasks, clock, supervision; after the flight: merged maps, changes, calibration |
//! | 11 | `doctor` | before the flight: what is connected, judged, with cures |
//! | 11 | `report`, `inventory` | after the flight: what it came to, for people and their programs; the books of a hall |
//! | 12 | `audit` | packs that others can compute again |

pub mod units;

pub mod time;

pub mod geometry;
pub mod stats;

pub mod messages;

pub mod localization;
pub mod mapping;

pub mod calibration;
pub mod planning;

pub mod mission;

pub mod pilot;

#[cfg(feature = "service")]
pub mod camera;
#[cfg(feature = "service")]
pub mod config;
#[cfg(feature = "service")]
pub mod export;
#[cfg(feature = "figures")]
pub mod figure;
#[cfg(feature = "service")]
pub mod lidar;
#[cfg(feature = "service")]
pub mod link;
#[cfg(feature = "service")]
pub mod pdf;
#[cfg(feature = "service")]
pub mod record;

#[cfg(feature = "service")]
pub mod service;
#[cfg(feature = "service")]
pub mod survey;
#[cfg(feature = "service")]
pub mod web;

#[cfg(feature = "service")]
pub mod doctor;
#[cfg(feature = "service")]
pub mod inventory;
#[cfg(feature = "service")]
pub mod markers;
#[cfg(feature = "service")]
pub mod report;

#[cfg(feature = "service")]
pub mod audit;
