"""Equations that models of several tests share."""

CONNECTED_SLIDER_CRANK = """\
  connect(ground.frame, main.a);
  connect(main.b, crank.a);
  connect(crank.b, pin.a);
  connect(pin.b, rod.a);
  connect(rod.b, gudgeon.b);
  connect(gudgeon.a, slider.frame);
  connect(ground.frame, line.a);
  connect(line.b, slider.frame);"""
