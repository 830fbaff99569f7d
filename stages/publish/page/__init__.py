"""Pages: what was found, as one self-contained HTML file that is readable on paper."""
