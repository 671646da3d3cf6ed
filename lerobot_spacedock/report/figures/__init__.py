"""The figures of a report: each a list of panels, drawn together for a paper and one by one for the page."""
