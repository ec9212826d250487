"""Reports: one plot style, tables for terminal and page, and one page template for everything that is reported."""
