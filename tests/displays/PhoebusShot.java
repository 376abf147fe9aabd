import java.io.*;
import java.util.*;
import java.util.concurrent.*;
import java.util.function.Consumer;

import javafx.application.Platform;
import javafx.embed.swing.SwingFXUtils;
import javafx.scene.*;
import javafx.scene.control.Labeled;
import javafx.stage.Stage;

import org.csstudio.display.builder.model.*;
import org.csstudio.display.builder.model.persist.ModelLoader;
import org.csstudio.display.builder.model.properties.CommonWidgetProperties;
import org.csstudio.display.builder.representation.javafx.JFXStageRepresentation;
import org.csstudio.display.builder.runtime.*;
import org.csstudio.display.builder.runtime.pv.RuntimePV;
import org.epics.vtype.VType;
import org.phoebus.framework.macros.Macros;
import org.phoebus.framework.preferences.PropertyPreferenceLoader;
import org.phoebus.pv.PV;

/** Opens .bob files in Phoebus's runtime and makes pictures of them. Orders on stdin, words
 *  separated by tabs; each ends with a line "done":
 *    open NAME FILE M=V ...   check NAME   wait NAME   shot NAME FILE SMALL   close NAME
 *  check waits for all PVs, then prints what is not connected and words that do not fit. */
public class PhoebusShot {
    static final int LIMIT = 30, SETTLE = 4; // s
    static final int MARGIN = 4;             // pixels above and below letters

    record Opened(Stage stage, JFXStageRepresentation representation, DisplayModel model) {}

    static final Map<String, Opened> opened = new HashMap<>();

    static <T> T inFx(Callable<T> what) throws Exception {
        FutureTask<T> task = new FutureTask<>(what);
        Platform.runLater(task);
        return task.get(60, TimeUnit.SECONDS);
    }

    static void each(Widget widget, Consumer<Widget> what) {
        what.accept(widget);
        widget.checkProperty(ChildrenProperty.DESCRIPTOR)
              .ifPresent(children -> children.getValue().forEach(w -> each(w, what)));
    }

    static List<String> unconnected(String name) {
        List<String> pvs = new ArrayList<>();
        each(opened.get(name).model(), widget -> {
            if (!widget.checkProperty(CommonWidgetProperties.propVisible)
                       .map(WidgetProperty::getValue).orElse(true))
                return; // what this PLC does not have
            WidgetRuntime<Widget> runtime = WidgetRuntime.ofWidget(widget);
            if (runtime == null)
                return;
            for (RuntimePV pv : runtime.getPVs()) {
                VType value = pv.read();
                if (value == null || PV.isDisconnected(value))
                    pvs.add("not connected: " + pv.getName());
            }
        });
        return pvs;
    }

    static void cut(Node node, List<String> lines) {
        if (node instanceof Labeled label && label.isVisible() && label.getText() != null) {
            var text = new javafx.scene.text.Text(label.getText());
            text.setFont(label.getFont());
            if (label.isWrapText())
                text.setWrappingWidth(label.getWidth());
            double wide = text.getLayoutBounds().getWidth();
            double high = text.getLayoutBounds().getHeight();
            if (wide > label.getWidth() + 1 || high > label.getHeight() + MARGIN)
                lines.add(String.format("\"%s\" needs %.0fx%.0f pixels, has %.0fx%.0f",
                                        label.getText(), wide, high, label.getWidth(),
                                        label.getHeight()));
        }
        if (node instanceof Parent parent)
            parent.getChildrenUnmodifiable().forEach(child -> cut(child, lines));
    }

    static void open(String[] word) throws Exception {
        Macros macros = new Macros();
        for (int i = 3; i < word.length; i++) {
            String[] pair = word[i].split("=", 2);
            macros.add(pair[0], pair[1]);
        }
        DisplayModel model = ModelLoader.resolveAndLoadModel(null, word[2]);
        model.expandMacros(macros);
        opened.put(word[1], inFx(() -> {
            Stage stage = new Stage();
            var representation = new JFXStageRepresentation(stage);
            RuntimeUtil.hookRepresentationListener(representation);
            Parent parent = representation.configureStage(model, m -> {});
            stage.setMinWidth(model.propWidth().getValue() + 20);
            stage.setMinHeight(model.propHeight().getValue() + 50);
            representation.representModel(parent, model);
            return new Opened(stage, representation, model);
        }));
        RuntimeUtil.startRuntime(model);
    }

    static void await(String name, boolean connected) throws Exception {
        for (int i = 0; i < LIMIT * 10 && unconnected(name).isEmpty() != connected; i++)
            Thread.sleep(100);
        Thread.sleep(SETTLE * 1000);
    }

    static void shot(String name, String file, String small) throws Exception {
        Opened it = opened.get(name);
        var all = SwingFXUtils.fromFXImage(inFx(() -> it.stage().getScene().snapshot(null)), null);
        var picture = all.getSubimage(0, 0, it.model().propWidth().getValue(),
                                      it.model().propHeight().getValue());
        javax.imageio.ImageIO.write(picture, "png", new File(file));
        int w = picture.getWidth() / 4, h = picture.getHeight() / 4;
        var less = new java.awt.image.BufferedImage(w, h, java.awt.image.BufferedImage.TYPE_INT_RGB);
        less.getGraphics().drawImage(
            picture.getScaledInstance(w, h, java.awt.Image.SCALE_SMOOTH), 0, 0, null);
        javax.imageio.ImageIO.write(less, "png", new File(small));
    }

    static void order(String[] word) throws Exception {
        switch (word[0]) {
        case "open" -> open(word);
        case "wait" -> await(word[1], false);
        case "check" -> {
            await(word[1], true);
            List<String> lines = unconnected(word[1]);
            inFx(() -> { cut(opened.get(word[1]).stage().getScene().getRoot(), lines); return 0; });
            lines.forEach(System.out::println);
        }
        case "shot" -> shot(word[1], word[2], word[3]);
        case "close" -> {
            Opened it = opened.remove(word[1]);
            RuntimeUtil.stopRuntime(it.model());
            inFx(() -> {
                it.representation().disposeRepresentation(it.model());
                it.stage().close();
                return 0;
            });
        }
        default -> throw new IllegalArgumentException(word[0]);
        }
    }

    public static void main(String[] args) throws Exception {
        PropertyPreferenceLoader.load(new FileInputStream(args[0]));
        CountDownLatch started = new CountDownLatch(1);
        Platform.setImplicitExit(false);
        Platform.startup(started::countDown);
        started.await();
        BufferedReader in = new BufferedReader(new InputStreamReader(System.in));
        for (String line; (line = in.readLine()) != null;) {
            order(line.split("\t"));
            System.out.println("done");
            System.out.flush();
        }
        System.exit(0);
    }
}
