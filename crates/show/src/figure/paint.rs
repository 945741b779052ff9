//! Painting of a drawing.

use anyhow::Context as _;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::drawing::{Drawing, Mark, Series};
use super::layout::{HEADING, LARGE, LEFT, LINE, Layout, MARGIN, MAX_NAME_CHARS, RIGHT, SMALL, WIDTH};
use super::number::number;

/// Okabe and Ito's colours.
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
];
/// The lines across the axes.
pub(super) const GRID: RGBColor = RGBColor(226, 226, 226);
/// Strokes of curves: length and gap of the dashes; none is a whole line.
const DASHES: [Option<[i32; 2]>; 4] = [None, Some([9, 5]), Some([2, 4]), Some([14, 3])];

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Every other series of bars is light.
fn shade(index: usize) -> f64 {
    if index.is_multiple_of(2) { 1.0 } else { 0.35 }
}

impl Drawing {
    pub(super) fn paint(&self, area: &Area<'_>, layout: &Layout) -> anyhow::Result<()> {
        let (x, y) = self.range().context("there is nothing to draw")?;
        let font = |size: u32| ("sans-serif", size).into_font();
        area.fill(&WHITE)?;
        let heading = font(LARGE).into_text_style(area).pos(Pos::new(HPos::Center, VPos::Top));
        for (line, at) in layout.title.iter().zip(0..) {
            area.draw_text(line, &heading, (WIDTH / 2, 8 + HEADING * at))?;
        }
        let below = area.margin(layout.top, 0, 0, 0);
        let mut chart = ChartBuilder::on(&below)
            .margin_top(10)
            .margin_left(MARGIN)
            .margin_right(RIGHT)
            .x_label_area_size(layout.below)
            .y_label_area_size(LEFT - MARGIN)
            .build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
        // A number of rounds has no halves.
        let mut places = self.series.iter().flat_map(|series| &series.points).map(|point| point.x);
        let is_whole = x[1] - x[0] < 20.0 && places.all(|x| x.fract() == 0.0);
        let label = |at: &f64| match is_whole && at.fract().abs() > 1e-9 {
            true => String::new(),
            false => number(*at),
        };
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .label_style(font(SMALL))
            .axis_desc_style(font(SMALL))
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_label_formatter(&label)
            .y_label_formatter(&|at| number(*at));
        if !self.groups.is_empty() {
            mesh.disable_x_mesh().x_labels(0);
        }
        mesh.draw()?;
        self.group_names(area, &chart, layout, y[0])?;
        if y[0] < 0.0 {
            chart
                .plotting_area()
                .draw(&PathElement::new(vec![(x[0], 0.0), (x[1], 0.0)], BLACK.stroke_width(1)))?;
        }
        for (index, series) in self.series.iter().enumerate() {
            if self.groups.is_empty() {
                self.curve(&mut chart, index, series)?;
            } else {
                self.bars(&chart, index, series)?;
            }
        }
        for (index, series) in self.series.iter().enumerate() {
            for mark in &series.marks {
                self.mark(area, &chart, index, mark)?;
            }
        }
        self.legend(area, layout)?;
        Ok(area.present()?)
    }

    /// Names of the groups below their bars. If they are too many to stand side by side, each is
    /// written upwards.
    fn group_names(
        &self,
        area: &Area<'_>,
        chart: &Chart<'_, '_>,
        layout: &Layout,
        bottom: f64,
    ) -> anyhow::Result<()> {
        let font = ("sans-serif", SMALL).into_font();
        let level = font.clone().into_text_style(area).pos(Pos::new(HPos::Center, VPos::Top));
        let upwards = font.transform(FontTransform::Rotate270).into_text_style(area);
        let upwards = upwards.pos(Pos::new(HPos::Right, VPos::Top));
        for (index, name) in self.groups.iter().enumerate() {
            let (x, y) = chart.plotting_area().map_coordinate(&(index as f64, bottom));
            match &layout.names {
                Some(names) => {
                    for (line, at) in names[index].iter().zip(0..) {
                        area.draw_text(line, &level, (x, y + 8 + LINE * at))?;
                    }
                }
                None => {
                    let short: String = name.chars().take(MAX_NAME_CHARS).collect();
                    area.draw_text(&short, &upwards, (x - 7, y + 8))?;
                }
            }
        }
        Ok(())
    }

    fn curve(&self, chart: &mut Chart<'_, '_>, index: usize, series: &Series) -> anyhow::Result<()> {
        let colour = COLOURS[index % COLOURS.len()];
        let band: Vec<(f64, [f64; 2])> =
            series.points.iter().filter_map(|point| Some((point.x, point.interval?))).collect();
        if band.len() > 1 {
            let upper = band.iter().map(|(x, [_, high])| (*x, *high));
            let lower = band.iter().rev().map(|(x, [low, _])| (*x, *low));
            let outline: Vec<(f64, f64)> = upper.chain(lower).collect();
            chart.draw_series([Polygon::new(outline, colour.mix(0.15))])?;
        }
        let points = || series.points.iter().map(|point| (point.x, point.y));
        let style = colour.stroke_width(2);
        match DASHES[index % DASHES.len()] {
            None => chart.draw_series(LineSeries::new(points(), style))?,
            Some([dash, gap]) => chart.draw_series(DashedLineSeries::new(points(), dash, gap, style))?,
        };
        if self.markers {
            let full = colour.filled();
            match index % 3 {
                0 => chart.draw_series(points().map(|at| Circle::new(at, 4, full)))?,
                1 => chart.draw_series(points().map(|at| TriangleMarker::new(at, 4, full)))?,
                _ => chart.draw_series(points().map(|at| Cross::new(at, 4, style)))?,
            };
        }
        Ok(())
    }

    /// Left and right end of a bar.
    fn bar(&self, index: usize, x: f64) -> [f64; 2] {
        let wide = 0.8 / self.series.len().max(1) as f64;
        let left = x - 0.4 + wide * index as f64;
        [left, left + 0.92 * wide]
    }

    fn bars(&self, chart: &Chart<'_, '_>, index: usize, series: &Series) -> anyhow::Result<()> {
        let colour = COLOURS[index % COLOURS.len()];
        let plot = chart.plotting_area();
        for point in &series.points {
            let [left, right] = self.bar(index, point.x);
            let bar = [(left, 0.0), (right, point.y)];
            plot.draw(&Rectangle::new(bar, WHITE.filled()))?;
            plot.draw(&Rectangle::new(bar, colour.mix(shade(index)).filled()))?;
            plot.draw(&Rectangle::new(bar, colour.stroke_width(1)))?;
            let Some([low, high]) = point.interval else { continue };
            let (middle, tick) = (0.5 * (left + right), 0.25 * (right - left));
            let end = |at: f64| vec![(middle - tick, at), (middle + tick, at)];
            for line in [vec![(middle, low), (middle, high)], end(low), end(high)] {
                plot.draw(&PathElement::new(line, BLACK.stroke_width(1)))?;
            }
        }
        Ok(())
    }

    /// A mark: a diamond, on a bar with a line across it, or a thin line across the axes.
    fn mark(&self, area: &Area<'_>, chart: &Chart<'_, '_>, index: usize, mark: &Mark) -> anyhow::Result<()> {
        let colour = COLOURS[index % COLOURS.len()];
        let place = |x: f64| chart.plotting_area().map_coordinate(&(x, mark.y));
        let Some(x) = mark.x else {
            let of =
                |series: &Series| series.marks.iter().any(|other| other.y == mark.y && other.x.is_none());
            let is_shared = self.series.iter().filter(|series| of(series)).count() > 1;
            let range = chart.x_range();
            return dashes(
                area,
                place(range.start),
                place(range.end),
                if is_shared { BLACK } else { colour },
            );
        };
        if self.groups.is_empty() {
            return diamond(area, place(x), colour);
        }
        let [left, right] = self.bar(index, x).map(place);
        area.draw(&PathElement::new(vec![left, right], WHITE.stroke_width(4)))?;
        area.draw(&PathElement::new(vec![left, right], BLACK.stroke_width(2)))?;
        diamond(area, ((left.0 + right.0) / 2, left.1), BLACK)
    }

    /// Names of the series with their strokes, and the name of the marks, between the heading and
    /// the axes.
    fn legend(&self, area: &Area<'_>, layout: &Layout) -> anyhow::Result<()> {
        let style = ("sans-serif", SMALL).into_font().into_text_style(area);
        for (index, (name, [x, y])) in self.legend_names().into_iter().zip(&layout.legend).enumerate() {
            let [x, y] = [*x, *y];
            let colour = COLOURS[index % COLOURS.len()];
            if index == self.series.len() {
                let is_line =
                    self.series.iter().flat_map(|series| &series.marks).all(|mark| mark.x.is_none());
                match is_line {
                    true => dashes(area, (x, y), (x + 22, y), BLACK)?,
                    false => diamond(area, (x + 11, y), BLACK)?,
                }
            } else if self.groups.is_empty() {
                let [dash, gap] = DASHES[index % DASHES.len()].unwrap_or([22, 1]);
                for at in (x..x + 22).step_by((dash + gap) as usize) {
                    let stroke = vec![(at, y), ((at + dash).min(x + 22), y)];
                    area.draw(&PathElement::new(stroke, colour.stroke_width(2)))?;
                }
            } else {
                let patch = [(x + 4, y - 5), (x + 18, y + 5)];
                area.draw(&Rectangle::new(patch, colour.mix(shade(index)).filled()))?;
                area.draw(&Rectangle::new(patch, colour.stroke_width(1)))?;
            }
            area.draw_text(name, &style, (x + 28, y - 5))?;
        }
        Ok(())
    }
}

fn diamond(area: &Area<'_>, (x, y): (i32, i32), colour: RGBColor) -> anyhow::Result<()> {
    let corners = vec![(x, y - 6), (x + 5, y), (x, y + 6), (x - 5, y)];
    area.draw(&Polygon::new(corners.clone(), WHITE.filled()))?;
    let outline = [corners.as_slice(), &corners[..2]].concat();
    Ok(area.draw(&PathElement::new(outline, colour.stroke_width(2)))?)
}

fn dashes(area: &Area<'_>, from: (i32, i32), to: (i32, i32), colour: RGBColor) -> anyhow::Result<()> {
    for at in (from.0..to.0).step_by(6) {
        area.draw(&PathElement::new(
            vec![(at, from.1), ((at + 3).min(to.0), from.1)],
            colour.stroke_width(1),
        ))?;
    }
    Ok(())
}
