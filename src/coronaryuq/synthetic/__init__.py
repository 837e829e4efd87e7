"""The bundled patient: anatomy, perfusion and clinical targets made from a documented seed."""
